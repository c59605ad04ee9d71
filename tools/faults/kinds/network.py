"""Faults between planner and slave: of the network, and of the planner's process."""

import signal
from collections.abc import Callable

from tools.faults.relay import Relay
from tools.faults.rig import Rig
from tools.faults.rows import Fault

PAUSE_S = 1.5
DELAY_S = 0.3


def _relay(rig: Rig) -> Relay:
    assert rig.relay
    return rig.relay


def _block(direction: str) -> Callable[[Rig], None]:
    def block(rig: Rig) -> None:
        _relay(rig).blocked = direction  # type: ignore[assignment]  # one of its words, below

    return block


def _delay(seconds: float) -> Callable[[Rig], None]:
    def delay(rig: Rig) -> None:
        _relay(rig).delay_s = seconds

    return delay


def _unblock_and_cut(rig: Rig) -> None:
    """Unblock and cut the connections: a stream that lost a part cannot continue, as behind a restarted middlebox."""
    relay = _relay(rig)
    relay.cut()
    relay.blocked = ""
    rig.pause(0.05)
    relay.accept_again()


def _restart_planner(rig: Rig) -> None:
    rig.end("planner")
    rig.start_planner("planner")
    rig.instruct("astern")


FAULTS = (
    Fault("network", "connections cut and refused", lambda rig: _relay(rig).cut(),
          lambda rig: _relay(rig).accept_again()),
    Fault("network", "black hole, then all at once", lambda rig: _relay(rig).hold(), lambda rig: _relay(rig).release(),
          hold_s=PAUSE_S, quick=True),
    Fault("network", "nothing reaches the slave", _block("to target"), _unblock_and_cut, hold_s=PAUSE_S),
    Fault("network", "nothing reaches the planner", _block("from target"), _unblock_and_cut, cuts=False,
          hold_s=PAUSE_S),
    Fault("network", "300 ms late", _delay(DELAY_S), _delay(0.0), cuts=False, extra_s=DELAY_S),
    Fault("process", "planner killed", lambda rig: rig.signal("planner", signal.SIGKILL), _restart_planner,
          hold_s=0.0),
    Fault("process", "planner paused for 2 s", lambda rig: rig.signal("planner", signal.SIGSTOP),
          lambda rig: rig.signal("planner", signal.SIGCONT), hold_s=PAUSE_S),
)  # fmt: skip
