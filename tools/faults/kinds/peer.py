"""Faults by other peers on the network: a second planner, floods, invalid and replayed commands."""

from collections.abc import Callable

from hil.common.children import module_command
from tools.faults.rig import OURS, START_S, Rig
from tools.faults.rows import Fault

FLOOD_S = 5.0  # permitted time for 5,000 declarations
LATE_S = 0.2  # permitted delay of a command by a flood that uses one of two processors


def _attack(kind: str, seconds: float = 0.0) -> Callable[[Rig], None]:
    """Start the attacker, and let the planner command during the attack."""

    def start(rig: Rig) -> None:
        command = [*module_command("tools.faults.attacker"), kind, f"tcp/127.0.0.1:{rig.port}"]
        rig.start_process("attacker", command, OURS).expect("attacking", START_S)
        rig.pause(seconds)

    return start


def _end_attack(rig: Rig) -> None:
    rig.end("attacker")


def _second_planner(rig: Rig) -> None:
    """Start a second planner that commands astern while the first commands ahead; then both are silent."""
    rig.start_planner("second")
    began = rig.pause(0.0)
    rig.instruct("astern", "second")
    rig.pause(1.0)
    rig.foreign = rig.pins.executed("astern", began)
    rig.instruct("silent", "second")
    rig.pause(0.2)


FAULTS = (
    Fault("peer", "a second planner", _second_planner, lambda rig: rig.end("second"), cuts=False),
    Fault("peer", "5,000 subscriptions", _attack("subscriptions", FLOOD_S), _end_attack, cuts=False, extra_s=LATE_S),
    Fault("peer", "5,000 tokens", _attack("tokens", FLOOD_S), _end_attack, cuts=False, extra_s=LATE_S),
    Fault("peer", "commands that are not finite", _attack("not_a_number"), _end_attack, cuts=False, quick=True),
    Fault("peer", "the planner's commands replayed", _attack("replay"), _end_attack, cuts=False),
    Fault("peer", "connections closed at once", _attack("connections"), _end_attack, cuts=False),
    Fault("peer", "bytes that are not zenoh", _attack("bytes"), _end_attack, cuts=False),
)
