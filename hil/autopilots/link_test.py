"""Measure the connection to an autopilot before a run: loss, round trip, jitter, and the rate that it can carry."""

import time
from typing import NamedTuple

from hil.autopilots.contract import Report
from hil.autopilots.opening import settings_of
from hil.autopilots.run import AutopilotRun
from hil.common.clock import NS_PER_MS, NS_PER_S, seconds_ns
from hil.links.address import parse_address
from hil.scenario.config import Scenario

BITS_A_BYTE = 10  # of a serial line: start bit, eight data bits, stop bit
HIL_SET_BYTES = 90  # per HIL_SENSOR message: its 77 bytes, and a share of HIL_GPS, ODOMETRY and HIL_STATE_QUATERNION
WARM_UP_NS = NS_PER_S // 2


class LinkResult(NamedTuple):
    """Result of a link test. Times in ms, rates in Hz; `speed`: simulation time per wall time.

    `line_rate`: greatest rate at the baud rate of a serial line, 0 for other connections.
    """

    states: int
    outputs: int
    lost: int
    malformed: int
    round_trip_p50_ms: float
    round_trip_p99_ms: float
    round_trip_max_ms: float
    output_rate: float
    speed: float
    line_rate: float

    @property
    def jitter_ms(self) -> float:
        """Return the difference between the 99th percentile and the median of the round trip, ms."""
        return self.round_trip_p99_ms - self.round_trip_p50_ms


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
        trips, outputs, states = list(run.round_trip.bins), figures.outputs, figures.states
        lost, malformed = figures.lost, figures.malformed
        start_ns, began = run.simulation.time_ns, time.monotonic()
        while run.simulation.time_ns < start_ns + seconds_ns(seconds):
            run.step()
        duration = time.monotonic() - began
        trip = run.round_trip.since(trips)
        return LinkResult(
            figures.states - states,
            figures.outputs - outputs,
            figures.lost - lost,
            figures.malformed - malformed,
            trip.quantile(0.5) / NS_PER_MS,
            trip.quantile(0.99) / NS_PER_MS,
            trip.maximum / NS_PER_MS,
            (figures.outputs - outputs) / duration,
            seconds / duration,
            line_rate(scenario),
        )


def line_rate(scenario: Scenario) -> float:
    """Return the rate of HIL_SENSOR (Hz) that the scenario's serial line can carry; 0 without a serial line."""
    settings = settings_of(scenario)
    if parse_address(settings.own_address(scenario.controller)).kind not in ("uart", "rs485"):
        return 0.0
    return settings.baud / BITS_A_BYTE / HIL_SET_BYTES
