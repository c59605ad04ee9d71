"""Run for hours and check every few seconds: memory growth, clock drift, reconnection of a master."""

import os
import select
import signal
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from math import isnan, nan
from random import Random
from statistics import linear_regression
from typing import NamedTuple

from hil.autonomy.control.controller import VelocityCommand
from hil.bench.harness import READY_S, Bench, await_vehicle
from hil.bench.presence import wait_for_silence
from hil.bench.processes import read_usage
from hil.client.client import VehicleClient
from hil.common.clock import NS_PER_MS
from hil.common.errors import NetworkError
from hil.common.quantiles import quantile
from hil.ros.diagnostics import Diagnostics, or_nan

COMMAND_HZ = 20.0
QUIET_S = 1.0  # time without an answer after which a vehicle is reported as silent
RETURN_S = 10.0  # limit until the vehicle answers a master that connects again
POLL_S = 0.25  # between two checks for a stop, while waiting for the vehicle
BLOCKS = 20  # of the record, which are resampled for an interval
DRAWS = 1000


class Observation(NamedTuple):
    """One reading of the slave: `at_s` since the start, threads, descriptors, and its own diagnostics.

    Memory (MiB) is the proportional set size, `private` the part that no other process shares. Its own
    diagnostics are nan while none come.
    """

    at_s: float
    memory: float
    private: float
    threads: int
    descriptors: int
    real_time_factor: float
    steps_skipped: float
    delay_p50_ms: float


class Outage(NamedTuple):
    """The slave ended, hung or could not be reached: start (s since the beginning), duration (s), and the symptom."""

    at_s: float
    seconds: float
    reason: str


class Soak(NamedTuple):
    """Readings of a soak test: times (s) of each return of the master until data flowed, None for never; silences.

    The first connection, when the slave starts, is not a return.
    """

    observations: list[Observation]
    returns: list[float | None]
    silences: list[Outage]


class Soaking:
    """A slave of `bench` under command. `watch` gets each reading; it ends when `stop_fd` becomes readable."""

    def __init__(self, bench: Bench, every: float, watch: Callable[[Observation], None], stop_fd: int = -1) -> None:
        self._bench, self._every, self._watch, self._stop_fd = bench, every, watch, stop_fd
        self._slave = bench.start_slave()
        self._began = time.monotonic()
        self._stopped = False
        self._quiet = ""  # the symptom of a slave that is silent now
        self._soak = Soak([], [], [])

    def run(self, seconds: float, leave_every: float) -> Soak:
        """Command it for `seconds`; the master disconnects and connects again every `leave_every` s.

        Raises NetworkError when the slave does not start. One that ends or hangs later is a silence.
        """
        end, first = self._began + seconds, True
        while time.monotonic() < end and not self._stopped and (first or self._slave.running):
            connected = time.monotonic()
            with self._bench.client() as client:
                came = self._await(client, first)
                if not (first or self._stopped):
                    self._soak.returns.append(came)
                if came is not None:
                    self._stay(client, min(connected + leave_every, end))
            first = False
        if not self._slave.running:
            self._add_silence(f"the slave {self._slave.ending}", 0.0)
        if self._quiet:
            self._kill()
        return self._soak

    def _await(self, client: VehicleClient, first: bool) -> float | None:
        """Return the seconds from connecting until data flowed; None if none did in time, or a stop is requested."""
        began = time.monotonic()
        while not self._pause(0.0):
            try:
                await_vehicle(client, self._slave, POLL_S)
                return ((client.first_sample_ns(0) or 0) - client.opened_wall_ns) * 1e-9
            except NetworkError:
                waited = time.monotonic() - began
                if first and (waited > READY_S or not self._slave.running):
                    raise
                if not first and waited > QUIET_S:
                    self._add_silence(f"{client.node} did not answer a master that came back", waited)
                if not first and (waited > RETURN_S or not self._slave.running):
                    return None
        return None

    def _stay(self, client: VehicleClient, end: float) -> None:
        """Command until `end`, or until a stop is requested, and read the state now and then."""
        due = time.monotonic() + self._every
        while time.monotonic() < end and self._slave.running and not self._pause(1.0 / COMMAND_HZ):
            client.command(VelocityCommand(surge=0.2, yaw_rate=0.2))
            there = client.contact.present
            absent = "" if there else f"{client.node} did not answer"
            self._add_silence(absent or wait_for_silence(client), 0.0 if there else client.contact.silence_s)
            if time.monotonic() >= due:
                due += self._every
                self._soak.observations.append(self._observe(client))
                self._watch(self._soak.observations[-1])

    def _observe(self, client: VehicleClient) -> Observation:
        """Return the present state of the slave."""
        usage = read_usage(self._slave.family())
        diagnostics = Diagnostics() if self._quiet else client.diagnostics()
        delays = sorted(client.delays.totals_ns(200)) if diagnostics else []
        return Observation(
            time.monotonic() - self._began,
            usage.pss_mib,
            usage.private_mib,
            usage.threads,
            usage.descriptors,
            or_nan(diagnostics.real_time_factor),
            or_nan(diagnostics.steps_skipped),
            quantile(delays, 0.5) / NS_PER_MS if delays else nan,
        )

    def _add_silence(self, reason: str, already_s: float) -> None:
        """Record a silence that has lasted for `already_s`, or extend the present one; the reason "" ends it."""
        at_s, silences = time.monotonic() - self._began, self._soak.silences
        if reason and not self._quiet:
            silences.append(Outage(at_s - already_s, already_s, reason))
        elif reason:
            silences[-1] = Outage(silences[-1].at_s, at_s - silences[-1].at_s, reason)
        self._quiet = reason

    def _pause(self, seconds: float) -> bool:
        """Wait; return whether a stop is requested."""
        watched = [self._stop_fd] if self._stop_fd >= 0 else []
        self._stopped = self._stopped or bool(select.select(watched, (), (), seconds)[0])
        return self._stopped

    def _kill(self) -> None:
        """Kill a slave that hangs: a signal to end would only take time."""
        for pid in self._slave.family():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)


def measured(values: Sequence[float]) -> list[float]:
    """Return the values that are not nan."""
    return [value for value in values if not isnan(value)]


def trend(at_s: Sequence[float], values: Sequence[float], seed: int = 1) -> tuple[float, float, float]:
    """Return the slope in units an hour by least squares, and the ends of its interval of 95 %.

    The interval is made by resampling blocks of the record.

    Blocks, because neighbours are alike (moving block bootstrap: Kuensch, Annals of Statistics 17, 1989).
    """
    if len(values) < 3:
        return nan, nan, nan
    random = Random(seed)
    length = max(len(values) // BLOCKS, 1)
    slope, rise = linear_regression(at_s, values)
    left = [value - (rise + slope * at) for at, value in zip(at_s, values, strict=True)]
    slopes = []
    for _ in range(DRAWS):
        drawn: list[float] = []
        while len(drawn) < len(values):
            first = random.randrange(len(left) - length + 1)
            drawn += left[first : first + length]
        slopes.append(linear_regression(at_s, drawn[: len(values)]).slope + slope)
    slopes.sort()
    per_hour = 3600.0
    return slope * per_hour, quantile(slopes, 0.025) * per_hour, quantile(slopes, 0.975) * per_hour
