"""Report exchange of a fleet over modems: TDMA slots, the 16-byte report, and the simulated channel.

The keys of [modem] are in `hil.scenario.modem_records`. Without that section, reports go over the network without delay
or rounding.
"""

from math import isfinite
from struct import Struct
from typing import NamedTuple

from hil.common.clock import NS_PER_MS, NS_PER_S, seconds_ns
from hil.common.errors import ConfigError
from hil.common.vectors import Vector3
from hil.scenario.config import Scenario
from hil.scenario.fleet import hunting_of
from hil.scenario.modem_records import Modem
from sim.environment.seawater.water_column import WaterColumn
from sim.environment.world import load_world
from sim.modems.acoustic import AcousticChannel
from sim.modems.usbl import UsblRounds
from sim.sensors.error import sensor_random

_REPORT = Struct("<iiHbbI")  # cm, cm, dm; 2 cm/s, 2 cm/s; ms
REPORT_BYTES = _REPORT.size


def modem_of(scenario: Scenario) -> Modem:
    """Return the [modem] section, checked against the fleet. Raises ConfigError if they do not fit."""
    modem = scenario.modem
    if modem is None:
        raise ConfigError(
            f"{scenario.path}: there is no [modem], so its vehicles report over the network: add one, or use the "
            "scenario of a fleet that has one, such as target_hunting_acoustic"
        )
    hunting = scenario.hunting
    airtime = modem.model.airtime_ns(REPORT_BYTES) / NS_PER_S
    if 0.0 < modem.slot < airtime:
        raise ConfigError(
            f"{scenario.path}: modem: slot: a report of {REPORT_BYTES} bytes takes {airtime:.3g} s, more than a slot; "
            "lengthen slot"
        )
    frame = modem.slot * len(scenario.member)
    if hunting and hunting.report_timeout < 2.0 * frame:
        raise ConfigError(
            f"{scenario.path}: hunting: report_timeout must be at least {2.0 * frame:g} s, twice "
            "what it takes until it is a vehicle's turn again"
        )
    return modem


class TdmaSchedule:
    """TDMA schedule: when member `number` (from 0) sends.

    It sends at the beginning of its slot. Without slots it sends at a random time, half to one and a half times
    `report_period` after its last report. All members use one clock; in HIL the clocks of the machines have to agree to
    a fraction of a slot.
    """

    def __init__(self, scenario: Scenario, number: int) -> None:
        slot_ns = seconds_ns(modem_of(scenario).slot)
        self._offset_ns = number * slot_ns
        self._frame_ns = slot_ns * len(scenario.member)
        self._mean_ns = seconds_ns(hunting_of(scenario).report_period)
        self._random = sensor_random(scenario.seed, f"turns/{number}")

    def after(self, time_ns: int) -> int:
        """Return the time (ns) of the first transmission after `time_ns`."""
        if not self._frame_ns:
            return time_ns + round(self._mean_ns * (0.5 + self._random.random()))
        passed = (time_ns - self._offset_ns) // self._frame_ns
        return (passed + 1) * self._frame_ns + self._offset_ns


class ModemReport(NamedTuple):
    """Report of one vehicle to the others: position (NED, m), velocity (m/s north, east), time in its plan (ns)."""

    position: Vector3
    velocity: tuple[float, float]
    clock_ns: int


def encode_report(report: ModemReport) -> bytes:
    """Encode a report in 16 bytes: to 1 cm, depth to 1 dm, 2 cm/s, 1 ms; limited to 6.5 km of depth and 2.5 m/s."""
    north, east, down = report.position
    speeds = [_bounded(50.0 * speed, -127, 127) for speed in report.velocity]
    level = [_bounded(100.0 * metres, -(2**31), 2**31 - 1) for metres in (north, east)]
    clock = _bounded(report.clock_ns / NS_PER_MS, 0, 2**32 - 1)
    return _REPORT.pack(*level, _bounded(10.0 * down, 0, 0xFFFF), *speeds, clock)


def decode_report(data: bytes) -> ModemReport | None:
    """Return the report in `data`; None if it is not one."""
    if len(data) != _REPORT.size:
        return None
    north, east, down, *speeds, clock = _REPORT.unpack(data)
    return ModemReport((0.01 * north, 0.01 * east, 0.1 * down), (0.02 * speeds[0], 0.02 * speeds[1]), clock * NS_PER_MS)


def _bounded(value: float, low: int, high: int) -> int:
    return min(max(round(value), low), high) if isfinite(value) else low


def open_channel(scenario: Scenario) -> AcousticChannel:
    """Return the channel between the modems of a fleet. Raises ConfigError."""
    model, world = modem_of(scenario).model, load_world(scenario.world)
    profile = world.ocean.profile if world.ocean else None
    column = WaterColumn(profile, world.gravity) if profile else None
    return AcousticChannel(model, world.depth, scenario.seed, column)


def open_usbl(scenario: Scenario, channel: AcousticChannel) -> UsblRounds:
    """Return the interrogations of the fleet's members with `usbl` over their `channel`. Raises ConfigError."""
    modem, nodes = modem_of(scenario), [member.node for member in scenario.member]
    heads = [member.node for member in scenario.member if member.usbl]
    errors = modem.usbl_angle, modem.model.range_error
    return UsblRounds(channel, heads, nodes, seconds_ns(modem.usbl_period), *errors, scenario.seed)
