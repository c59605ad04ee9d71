"""Lamps, camera tilt, gripper, free servo outputs and relays of the vehicle, as a pilot's software commands them.

Each accessory hangs at a servo output, as on a BlueROV2: its pulse is what SERVO_OUTPUT_RAW shows.
"""

from collections.abc import Callable
from typing import NamedTuple

from hil.links.contract import LEAST_US, MOST_US, PWM_NEUTRAL_US

FIRST, LAST = 9, 16  # outputs that are no thrusters'
RELAYS = 4
TILT_MOST = 45.0  # degrees, at the ends of the pulse


class Output(NamedTuple):
    """A servo output, its first pulse, and the accessory at it ("": none in the simulation)."""

    number: int
    first_us: int
    accessory: str = ""


OUTPUTS = {
    "Lights1": Output(9, LEAST_US, "lights"), "Lights2": Output(10, LEAST_US),
    "Gripper": Output(11, PWM_NEUTRAL_US, "gripper"), "CamTilt": Output(12, PWM_NEUTRAL_US, "camera_tilt"),
    "CamPan": Output(13, PWM_NEUTRAL_US),
}  # fmt: skip
STICK_CHANNELS = 6
CHANNELS = {7: "CamPan", 8: "CamTilt", 9: "Lights1", 10: "Lights2"}  # of RC channels, as ArduSub has them
PANEL = ("CamTilt", "CamPan", "Lights1", "Lights2")


class Accessories:
    """Pulses (us) of the servo outputs. `move` gets an accessory and its share: 0 to 1 of lamps, else -1 to 1."""

    def __init__(self, move: Callable[[str, float], None]) -> None:
        self._move = move
        self.pulses = {row.number: row.first_us for row in OUTPUTS.values()}
        self.relays = [False] * RELAYS

    def reset(self) -> None:
        """Give each output its first pulse."""
        for name, row in OUTPUTS.items():
            self.set_named(name, row.first_us)

    def share(self, name: str) -> float:
        """Return the pulse of a row of OUTPUTS as a share, 0 to 1."""
        return (self.pulses[OUTPUTS[name].number] - LEAST_US) / (MOST_US - LEAST_US)

    @property
    def tilt(self) -> float:
        """Tilt of the camera in degrees, up is positive."""
        return TILT_MOST * (2.0 * self.share("CamTilt") - 1.0)

    def set_pulse(self, output: int, pulse_us: float) -> bool:
        """Set the pulse of an output; return whether there is such an output."""
        if not (FIRST <= output <= LAST and pulse_us == pulse_us):
            return False
        self.pulses[output] = round(min(max(pulse_us, LEAST_US), MOST_US))
        for name, row in OUTPUTS.items():
            if row.number == output and row.accessory:
                share = self.share(name)
                self._move(row.accessory, share if row.accessory == "lights" else 2.0 * share - 1.0)
        return True

    def switch(self, relay: int, on: bool | None) -> bool:
        """Switch a relay on, off, or to its other state (None); return whether there is such a relay."""
        if not 0 <= relay < RELAYS:
            return False
        self.relays[relay] = not self.relays[relay] if on is None else on
        return True

    def set_named(self, name: str, pulse_us: float) -> None:
        """Set the pulse of a row of OUTPUTS."""
        self.set_pulse(OUTPUTS[name].number, pulse_us)

    def change(self, name: str, step: float) -> None:
        """Move a row of OUTPUTS by a share of its whole range."""
        self.set_named(name, LEAST_US + (self.share(name) + step) * (MOST_US - LEAST_US))

    def turn_to(self, name: str, degrees: float) -> None:
        """Turn the camera: CamTilt up, CamPan to starboard."""
        self.set_named(name, PWM_NEUTRAL_US + (MOST_US - PWM_NEUTRAL_US) * degrees / TILT_MOST)
