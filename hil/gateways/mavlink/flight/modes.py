"""Modes of the vehicle, with ArduSub's numbers."""

from enum import IntEnum
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect


class Mode(IntEnum):
    """The number of a mode in HEARTBEAT.custom_mode, as ArduSub has it."""

    STABILIZE = dialect.SUB_MODE_STABILIZE
    ALT_HOLD = dialect.SUB_MODE_ALT_HOLD
    AUTO = dialect.SUB_MODE_AUTO
    GUIDED = dialect.SUB_MODE_GUIDED
    SURFACE = dialect.SUB_MODE_SURFACE
    POSHOLD = dialect.SUB_MODE_POSHOLD
    MANUAL = dialect.SUB_MODE_MANUAL


class ModeText(NamedTuple):
    """Description of a mode: its name, and what it does."""

    name: str
    meaning: str


MODES: dict[Mode, ModeText] = {
    Mode.MANUAL: ModeText("Manual", "sticks are forces and moments"),
    Mode.STABILIZE: ModeText("Stabilize", "sticks are velocities; roll and pitch are level, the heading is held"),
    Mode.ALT_HOLD: ModeText("Depth hold", "as Stabilize; the depth is held, too"),
    Mode.POSHOLD: ModeText("Position hold", "as Depth hold; the position is held, too"),
    Mode.GUIDED: ModeText("Guided", "follows position and velocity targets of companion software"),
    Mode.AUTO: ModeText("Auto", "flies the mission"),
    Mode.SURFACE: ModeText("Surface", "rises to the surface and holds the heading"),
}
PILOTED = frozenset((Mode.MANUAL, Mode.STABILIZE, Mode.ALT_HOLD, Mode.POSHOLD))
POSITIONED = frozenset((Mode.GUIDED, Mode.AUTO, Mode.POSHOLD))  # modes that need a position


def mode_of(number: float) -> Mode | None:
    """Return the mode with that number, None if there is none."""
    return Mode(int(number)) if number == number and abs(number) < 1e6 and number in list(Mode) else None


def mode_name(number: float) -> str:
    """Return ArduSub's name of a mode that this vehicle lacks; "mode N" for a number that has none."""
    entry = dialect.enums["SUB_MODE"].get(number)
    return entry.name.removeprefix("SUB_MODE_").capitalize() if entry else f"mode {number:g}"


def base_mode(mode: Mode, armed: bool) -> int:
    """Return the flags of HEARTBEAT.base_mode, as ArduSub sets them: each mode counts as stabilized and piloted."""
    flags: int = (
        dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | dialect.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        | dialect.MAV_MODE_FLAG_STABILIZE_ENABLED
    )  # fmt: skip
    flags |= dialect.MAV_MODE_FLAG_GUIDED_ENABLED if mode in POSITIONED else 0
    return flags | (dialect.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
