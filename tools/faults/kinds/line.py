"""Faults of the thruster link, and of what is at its two ends: the STM32 and the slave."""

import signal
import time
from collections.abc import Callable

from tools.faults.links import LINKS
from tools.faults.rig import Rig
from tools.faults.rows import Fault

CUTTABLE = tuple(link for link in LINKS if link.wire != "can")
TERMINALS = tuple(link for link in LINKS if link.wire == "pty")
# The slowest line that carries 50 commands a second; a scenario with a slower one is refused.
CARRIES_BYTES_A_S = {"frame": 1920.0, "mavlink": 3840.0}
SLOW_BYTES_A_S = {"frame": 500.0, "mavlink": 1000.0}  # 12 commands a second and their reports
PAUSE_S = 1.5
RESET_S = 0.3  # between the end of an STM32 and its power-up


def _set(**values: object) -> Callable[[Rig], None]:
    def change(rig: Rig) -> None:
        for name, value in values.items():
            setattr(rig.line, name, value)

    return change


def _slow(bytes_a_s: dict[str, float]) -> Callable[[Rig], None]:
    return lambda rig: setattr(rig.line, "bytes_a_s", bytes_a_s[rig.link.protocol])


def _clear(rig: Rig) -> None:
    rig.line.clear()


def _signal(name: str, number: int) -> Callable[[Rig], None]:
    def send(rig: Rig) -> None:
        if name == "stm32":
            rig.signal_stm32(number)
        else:
            rig.signal(name, number)

    return send


def _restart_slave(rig: Rig) -> None:
    """Start the slave again once it has ended, as its service manager does."""
    rig.processes.pop("slave").wait(10.0)
    rig.start_slave()


def _pause_stm32(rig: Rig) -> None:
    rig.signal_stm32(signal.SIGSTOP)
    time.sleep(PAUSE_S)
    rig.instruct("silent")
    time.sleep(rig.link.limit_s)


FAULTS = (
    Fault("link", "unplugged", lambda rig: rig.line.unplug(), lambda rig: rig.line.plug(), links=CUTTABLE, quick=True),
    Fault("link", "noise both ways", _set(noise=True), _clear, cuts=False, links=LINKS),
    Fault("link", "half of each frame", _set(halves=True), _clear, links=CUTTABLE),
    Fault("link", "commands lost", _set(down=False), _clear, links=CUTTABLE),
    Fault("link", "reports lost", _set(up=False), _clear, cuts=False, links=CUTTABLE),
    Fault("link", "slowest permitted line", _slow(CARRIES_BYTES_A_S), _clear, cuts=False, links=TERMINALS),
    Fault("link", "line slower than the commands", _slow(SLOW_BYTES_A_S), _clear, cuts=False, links=TERMINALS),
    Fault("process", "STM32 killed", lambda rig: rig.kill_stm32(), lambda rig: rig.revive_stm32(), links=LINKS,
          hold_s=RESET_S),
    Fault("process", "STM32 paused for 2 s", _pause_stm32, _signal("stm32", signal.SIGCONT), links=LINKS,
          hold_s=0.0, after_removal=True),
    Fault("process", "slave killed", _signal("slave", signal.SIGKILL), _restart_slave, links=LINKS, hold_s=0.2,
          quick=True),
    Fault("process", "slave terminated", _signal("slave", signal.SIGTERM), _restart_slave, links=LINKS, hold_s=0.2),
    Fault("process", "slave paused for 2 s", _signal("slave", signal.SIGSTOP), _signal("slave", signal.SIGCONT),
          links=LINKS, hold_s=PAUSE_S),
)  # fmt: skip
