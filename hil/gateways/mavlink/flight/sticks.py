"""Sticks of one pilot at a time, from MANUAL_CONTROL or RC_CHANNELS_OVERRIDE, forgotten when the sender is silent."""

from typing import Any, NamedTuple

from hil.gateways.mavlink.parameter_table import ParameterTable
from hil.links.contract import MOST_US, PWM_NEUTRAL_US

INVALID = 0x7FFF  # an axis that the sender does not have
FULL = 1000.0
PITCH_EXTENSION, ROLL_EXTENSION = 1, 2  # bits of enabled_extensions
SPAN_US = MOST_US - PWM_NEUTRAL_US  # of a channel
CHANNELS = 18
AXES = "mkzrxy"  # the axes of channels 1 to 6, as ArduSub has them
IGNORED = 0xFFFF
HOLD_LEAST = 0.05  # what Input Hold takes for a deflection

Sender = tuple[int, int, int]  # peer, system, component


class Sticks(NamedTuple):
    """Stick positions, -1 to 1: x ahead, y to starboard, z up, r turns to starboard, k rolls, m pitches up."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    r: float = 0.0
    k: float = 0.0
    m: float = 0.0


CENTRED = Sticks()


class Joystick:
    """Store the newest sticks. Of several senders the first one counts until its sticks have expired.

    Counts packets of others (`refused`) and those that waited too long before they were read (`stale`). `gain` scales
    MANUAL_CONTROL, `holds` are the deflections that Input Hold adds, with `turns_hull` x and y are pitch and roll.
    """

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        self.gain = parameters["JS_GAIN_DEFAULT"]
        self.turns_hull = False
        self.holds = (0.0, 0.0, 0.0)
        self.refused = 0
        self.stale = 0
        self.release()

    def receive(self, packet: Any, sender: Sender, now: int, lasts_ns: int, is_stale: bool = False) -> bool:
        """Take a MANUAL_CONTROL; return whether it counts. z is 0 to 1000 with 500 neutral, as ArduSub has it."""
        if not self._is_admitted(sender, now, lasts_ns, is_stale):
            return False
        extensions = packet.enabled_extensions
        sticks = Sticks(
            _axis(packet.x),
            _axis(packet.y),
            0.0 if packet.z == INVALID else (min(max(packet.z, 0), 1000) - 500) / 500.0,
            _axis(packet.r),
            _axis(packet.t) if extensions & ROLL_EXTENSION else 0.0,
            _axis(packet.s) if extensions & PITCH_EXTENSION else 0.0,
        )
        self._deflection = sticks
        x, y, z = self._held(sticks)
        if self.turns_hull:
            sticks = sticks._replace(x=self.holds[0], y=self.holds[1], z=z, k=y, m=-x)
        else:
            sticks = sticks._replace(x=x, y=y, z=z)
        self._sticks = Sticks(*[self.gain * min(max(axis, -1.0), 1.0) for axis in sticks])
        return True

    def override(
        self, packet: Any, sender: Sender, now: int, lasts_ns: int, is_stale: bool = False
    ) -> dict[int, int] | None:
        """Take an RC_CHANNELS_OVERRIDE; return its pulses (us) by channel, 0: released; None if it does not count."""
        if not self._is_admitted(sender, now, lasts_ns, is_stale):
            return None
        changed = {}
        for channel in range(1, CHANNELS + 1):
            pulse = getattr(packet, f"chan{channel}_raw")
            if pulse == IGNORED or (channel > 8 and pulse == 0):
                continue
            changed[channel] = 0 if pulse == IGNORED - 1 else pulse
            if channel <= len(AXES):
                axis = (pulse - PWM_NEUTRAL_US) / SPAN_US if pulse else 0.0
                self._sticks = self._sticks._replace(**{AXES[channel - 1]: min(max(axis, -1.0), 1.0)})
        return changed

    def is_alive(self, now: int) -> bool:
        """Return whether somebody holds the sticks."""
        return self._sender is not None and now <= self._until_ns

    def sticks(self, now: int) -> Sticks:
        """Return the sticks, centred if nobody holds them; what is within the dead zone is 0."""
        if not self.is_alive(now):
            return CENTRED
        dead_zone = self._parameters["HIL_DEADZONE"] * self.gain
        return Sticks(*[0.0 if abs(axis) <= dead_zone else axis for axis in self._sticks])

    def channels(self, now: int) -> tuple[int, ...]:
        """Return the sticks as pulses (us) of the channels that they have in ArduSub."""
        sticks = self.sticks(now)
        return tuple([PWM_NEUTRAL_US + round(SPAN_US * getattr(sticks, name)) for name in AXES])

    def release(self) -> None:
        """Forget the sticks and who held them."""
        self._sticks = self._deflection = CENTRED
        self._sender: Sender | None = None
        self._until_ns = 0
        self.holds = (0.0, 0.0, 0.0)
        self._awaits_centre = False

    def change_gain(self, steps: int) -> float:
        """Change the gain by steps of JS_GAIN_STEPS between its limits; return it."""
        least, most = self._parameters["JS_GAIN_MIN"], self._parameters["JS_GAIN_MAX"]
        step = (most - least) / max(1.0, self._parameters["JS_GAIN_STEPS"] - 1.0)
        self.gain = min(max(self.gain + steps * step, least), most)
        return self.gain

    def hold(self) -> bool:
        """Hold x, y and z as they are deflected now, or nothing if they are centred; return whether they are held."""
        x, y, z = [axis if abs(axis) > HOLD_LEAST else 0.0 for axis in self._deflection[:3]]
        self.holds = x, y, z
        self._awaits_centre = any(self.holds)
        return self._awaits_centre

    def _held(self, sticks: Sticks) -> tuple[float, float, float]:
        """Return x, y and z with those that are held, which alone count until the sticks were centred."""
        if self._awaits_centre:
            self._awaits_centre = any(abs(axis) > HOLD_LEAST for axis in sticks[:3])
            return self.holds
        x, y, z = [axis + held for axis, held in zip(sticks[:3], self.holds, strict=True)]
        return x, y, z

    def _is_admitted(self, sender: Sender, now: int, lasts_ns: int, is_stale: bool) -> bool:
        """Return whether a packet counts, whose sticks last for this time (ns)."""
        if is_stale:
            self.stale += 1
            return False
        if not self.is_alive(now):
            self.release()
        elif sender != self._sender:
            self.refused += 1
            return False
        self._sender, self._until_ns = sender, now + lasts_ns
        return True


def _axis(value: int) -> float:
    return 0.0 if value == INVALID else value / FULL
