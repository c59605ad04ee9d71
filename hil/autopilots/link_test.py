"""Measure the connection to an autopilot before a run: loss, round trip, jitter, and the rate that it can carry."""

import time
from typing import NamedTuple

from hil.autopilots.contract import AutopilotCounters, Report
from hil.autopilots.opening import settings_of
from hil.autopilots.run import AutopilotRun
from hil.common.clock import NS_PER_S, Histogram, seconds_ns
from hil.links.address import parse_address
from hil.scenario.config import Scenario

BITS_A_BYTE = 10  # of a serial line: start bit, eight data bits, stop bit
HIL_SET_BYTES = 90  # per HIL_SENSOR message: its 77 bytes, and a share of HIL_GPS, ODOMETRY and HIL_STATE_QUATERNION
WARM_UP_NS = NS_PER_S // 2


class LinkResult(NamedTuple):
    """Counts of a link test, its round trips (ns), and how long it took in simulated and in wall time (s)."""

    states: int
    outputs: int
    lost: int
    malformed: int
    round_trip: Histogram
    simulated_s: float
    took_s: float


def measure_link(scenario: Scenario, seconds: float, report: Report) -> LinkResult:
    """Exchange states and outputs for `seconds` of simulation time with neutral thrusters; return the result.

    In lockstep it runs as fast as the autopilot replies, so it measures the greatest rate. Raises DeviceError,
    ConfigError.
    """
    with AutopilotRun(scenario, report) as run:
        run.ignores_outputs = True
        figures = run.autopilot.figures
        while figures.outputs < 2 or run.simulation.time_ns < WARM_UP_NS:  # the autopilot boots
            run.step()
        trips, before = list(run.round_trip.bins), _counts(figures)
        start_ns, began = run.simulation.time_ns, time.monotonic()
        while run.simulation.time_ns < start_ns + seconds_ns(seconds):
            run.step()
        took_s = time.monotonic() - began
        states, outputs, lost, malformed = (a - b for a, b in zip(_counts(figures), before, strict=True))
        return LinkResult(states, outputs, lost, malformed, run.round_trip.since(trips), seconds, took_s)


def _counts(figures: AutopilotCounters) -> tuple[int, int, int, int]:
    return figures.states, figures.outputs, figures.lost, figures.malformed


def line_rate(scenario: Scenario) -> float:
    """Return the rate of HIL_SENSOR (Hz) that the scenario's serial line can carry; 0 without a serial line."""
    settings = settings_of(scenario)
    if parse_address(settings.own_address(scenario.controller)).kind not in ("uart", "rs485"):
        return 0.0
    return settings.baud / BITS_A_BYTE / HIL_SET_BYTES
