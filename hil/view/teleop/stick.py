"""Commands from the axes and buttons of a stick: a state machine without a clock or I/O."""

from collections.abc import Mapping
from math import isfinite
from operator import mul
from typing import Any, Literal, NamedTuple

SILENT_AFTER_NS = 300_000_000  # a stick without a message for so long counts as released; it sends 20 a second
AXES = ("surge", "sway", "heave", "yaw")
Mode = Literal["velocity", "effort"]
# Commands at full deflection of the axes: m/s and rad/s, N and N m.
FULL: dict[Mode, tuple[float, float, float, float]] = {
    "velocity": (0.5, 0.5, 0.3, 0.5),
    "effort": (40.0, 40.0, 40.0, 10.0),
}


class StickCommand(NamedTuple):
    """A command in FRD: velocities (m/s, rad/s), or forces (N) and a moment (N m) about the vertical axis."""

    mode: Mode
    surge: float
    sway: float
    heave: float
    yaw: float
    hold_depth: bool
    hold_heading: bool


class Stick:
    """One person's stick. The vehicle moves only while the dead man's switch is held and messages come."""

    def __init__(self) -> None:
        self._received_ns = 0
        self._held = False
        self._command: StickCommand | None = None
        self.malformed = 0

    def update(self, message: Mapping[str, Any], now_ns: int) -> None:
        """Handle a message of the stick; `axes` are numbers from -1 to 1. A malformed message releases the stick."""
        self._received_ns = now_ns
        axes = message.get("axes")
        given = [axes.get(name, 0.0) for name in AXES] if isinstance(axes, Mapping) else []
        values = [max(-1.0, min(1.0, value)) for value in given if isinstance(value, int | float) and isfinite(value)]
        if len(values) != len(AXES):
            self.malformed += 1
            self._held = False
            return
        self._held = message.get("held") is True
        mode: Mode = "effort" if message.get("mode") == "effort" else "velocity"
        surge, sway, heave, yaw = map(mul, values, FULL[mode])
        holds = message.get("hold_depth") is True, message.get("hold_heading") is True
        self._command = StickCommand(mode, surge, sway, heave, yaw, *holds)

    def command(self, now_ns: int) -> StickCommand | None:
        """Return the requested command; None while the switch is not held, or without a message for 0.3 s."""
        if now_ns - self._received_ns > SILENT_AFTER_NS:
            self._held = False
        return self._command if self._held else None
