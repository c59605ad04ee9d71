"""The modems by which the vehicles of a fleet talk, and when it is whose turn.

[modem]
kind = "acoustic"             # or "optical"
slot = "250 ms"               # each vehicle sends at the beginning of its slot; 0: at random, about every report_period
source_level = 168.0          # and any other key of sim.modems.acoustic.AcousticModem, or of optical.OpticalModem

Without this table reports go over the network, at once and whole.
"""

from collections import Counter
from collections.abc import Mapping
from math import isfinite
from struct import Struct
from typing import Annotated, Any, Literal, NamedTuple, Protocol

from hil.clock import NS_PER_MS, NS_PER_S, seconds_ns
from hil.config import Scenario
from hil.errors import ConfigError
from hil.fleet import hunting_of
from hil.schema import Range, parse
from sim.modems.acoustic import AcousticChannel, AcousticModem, Packet
from sim.modems.optical import OpticalModem
from sim.modems.optical_channel import OpticalChannel, Pose
from sim.sensors.error import sensor_random
from sim.water import WaterColumn
from sim.world import World, load_world

Vector3 = tuple[float, float, float]

_MODELS: dict[str, type[AcousticModem] | type[OpticalModem]] = {"acoustic": AcousticModem, "optical": OpticalModem}
_TELEGRAM = Struct("<iiHbbI")  # cm, cm, dm; 2 cm/s, 2 cm/s; ms


class Modem(NamedTuple):
    """The [modem] table: `slot` s is each vehicle's share of the time, 0 for none; `model` has the modem's own keys."""

    kind: Literal["acoustic", "optical"] = "acoustic"
    slot: Annotated[float, Range(0.0, 60.0, "s")] = 0.25
    model: AcousticModem | OpticalModem = AcousticModem()  # read by read_modem


def read_modem(table: dict[str, Any], where: str) -> Modem:
    """The [modem] table of a scenario. Raises ConfigError."""
    modem = parse({key: value for key, value in table.items() if key in ("kind", "slot")}, Modem, where)
    own = {key: value for key, value in table.items() if key not in ("kind", "slot")}
    return modem._replace(model=parse(own, _MODELS[modem.kind], where))


def modem_of(scenario: Scenario) -> Modem:
    """Its [modem], which fits the fleet. Raises ConfigError where it does not."""
    modem, hunting = scenario.modem, hunting_of(scenario)
    if modem is None:
        raise ConfigError(f"{scenario.path}: there is no [modem]: its vehicles talk over the network")
    airtime = modem.model.airtime_ns(_TELEGRAM.size) / NS_PER_S
    if 0.0 < modem.slot < airtime:
        raise ConfigError(
            f"{scenario.path}: modem: slot: a report of {_TELEGRAM.size} bytes takes {airtime:.3g} s, more than a slot"
        )
    frame = modem.slot * len(scenario.member)
    if hunting.forget < 2.0 * frame:
        raise ConfigError(
            f"{scenario.path}: hunting: forget must be at least {2.0 * frame:g} s, twice what it takes until it is a "
            "vehicle's turn again"
        )
    return modem


class Turns:
    """When member `number` (from 0) sends: at the beginning of its slot; without slots half to one and a half times
    report_period after it sent last, by lot.

    All who take turns go by one clock (in HIL that of the machines, which have to agree to a fraction of a slot).
    """

    def __init__(self, scenario: Scenario, number: int) -> None:
        slot_ns = seconds_ns(modem_of(scenario).slot)
        self._offset_ns = number * slot_ns
        self._frame_ns = slot_ns * len(scenario.member)
        self._mean_ns = seconds_ns(hunting_of(scenario).report_period)
        self._random = sensor_random(scenario.seed, f"turns/{number}")

    def after(self, time_ns: int) -> int:
        """Its first turn after this instant, ns."""
        if not self._frame_ns:
            return time_ns + round(self._mean_ns * (0.5 + self._random.random()))
        passed = (time_ns - self._offset_ns) // self._frame_ns
        return (passed + 1) * self._frame_ns + self._offset_ns


class Telegram(NamedTuple):
    """What one vehicle tells the others: position (NED, m), velocity (m/s north, m/s east), its plan's clock (ns)."""

    position: Vector3
    velocity: tuple[float, float]
    clock_ns: int


def encode_telegram(telegram: Telegram) -> bytes:
    """In 16 bytes: to 1 cm, depth to 1 dm, 2 cm/s and 1 ms; what is beyond (6.5 km deep, 2.5 m/s) at its limit."""
    north, east, down = telegram.position
    speeds = [_bounded(50.0 * speed, -127, 127) for speed in telegram.velocity]
    level = [_bounded(100.0 * metres, -(2**31), 2**31 - 1) for metres in (north, east)]
    clock = _bounded(telegram.clock_ns / NS_PER_MS, 0, 2**32 - 1)
    return _TELEGRAM.pack(*level, _bounded(10.0 * down, 0, 0xFFFF), *speeds, clock)


def decode_telegram(data: bytes) -> Telegram | None:
    """What `encode_telegram` packed; None if that is not it."""
    if len(data) != _TELEGRAM.size:
        return None
    north, east, down, *speeds, clock = _TELEGRAM.unpack(data)
    return Telegram((0.01 * north, 0.01 * east, 0.1 * down), (0.02 * speeds[0], 0.02 * speeds[1]), clock * NS_PER_MS)


def _bounded(value: float, low: int, high: int) -> int:
    return min(max(round(value), low), high) if isfinite(value) else low


class Channel(Protocol):
    """The water between modems: who gets what, when, and what is lost. Calls come in the order of time."""

    counts: Counter[str]

    def send(self, time_ns: int, sender: str, payload: bytes, places: Mapping[str, Pose]) -> int:
        """Send to all others in `places`, who are where they truly are; when it is through (ns), 0 if it cannot be."""

    def receive(self, time_ns: int) -> list[Packet]:
        """The messages that have come by now."""


def open_channel(scenario: Scenario) -> Channel:
    """The water between the modems of a fleet. Raises ConfigError."""
    model = modem_of(scenario).model
    if isinstance(model, OpticalModem):
        return OpticalChannel(model, scenario.seed)
    return _Acoustic(model, load_world(scenario.world), scenario.seed)


class _Acoustic:
    """Sound does not care where a vehicle looks."""

    def __init__(self, model: AcousticModem, world: World, seed: int) -> None:
        profile = world.ocean.profile if world.ocean else None
        column = WaterColumn(profile, world.gravity) if profile else None
        self._channel = AcousticChannel(model, world.depth, seed, column)
        self.counts = self._channel.counts
        self.receive = self._channel.receive

    def send(self, time_ns: int, sender: str, payload: bytes, places: Mapping[str, Pose]) -> int:
        """As `Channel.send` says."""
        return self._channel.send(time_ns, sender, payload, {name: pose.position for name, pose in places.items()})
