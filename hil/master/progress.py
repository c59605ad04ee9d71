"""What a person sees while a mission runs."""

import sys
import time
from contextlib import suppress

from hil.master.client import VehicleClient
from hil.master.delay import quantiles
from sim.sensors.samples import OdometrySample

TERMINAL_PERIOD_S = 0.2
LINE_PERIOD_S = 5.0


class Progress:
    """One line that renews itself on a terminal; elsewhere a line every five seconds. All goes to a log as well.

    When `quiet` the log is all.
    """

    def __init__(self, log_path: str, quiet: bool = False) -> None:
        self._log = open(log_path, "w")  # noqa: SIM115 - closed by close()
        self._logged_s = 0.0
        self._quiet = quiet
        self._terminal = sys.stdout.isatty()
        self._period_s = TERMINAL_PERIOD_S if self._terminal else LINE_PERIOD_S
        self._next_s = 0.0
        self._open_line = False
        self._noted_s = -LINE_PERIOD_S

    def say(self, text: str) -> None:
        """A line of its own."""
        if self._open_line:
            print()
            self._open_line = False
        if not self._quiet:
            print(text, flush=True)
        self._write(text)

    def close(self) -> None:
        """Close the log."""
        with suppress(OSError):  # the disk is full: what it took stays
            self._log.close()

    def _write(self, line: str) -> None:
        with suppress(OSError):  # the mission goes on without
            self._log.write(line + "\n")

    def note(self, text: str) -> None:
        """A line of its own, but at most one a second."""
        now = time.monotonic()
        if now - self._noted_s > 1.0:
            self._noted_s = now
            self.say(text)

    def show(self, elapsed: float, truth: OdometrySample, share: float, client: VehicleClient) -> None:
        """The state of the run, if it is time to show it again."""
        if elapsed < self._next_s:
            return
        self._next_s = elapsed + self._period_s
        line = _line(elapsed, truth, share, client)
        if elapsed >= self._logged_s:
            self._logged_s = elapsed + 1.0
            self._write(line)
        if self._quiet:
            return
        if self._terminal:
            print("\r\x1b[K" + line, end="", flush=True)
            self._open_line = True
        else:
            print(line, flush=True)


def _line(elapsed: float, truth: OdometrySample, share: float, client: VehicleClient) -> str:
    north, east, depth = truth.position
    health = client.diagnostics()
    totals = client.delays.totals_ns(newest=100)
    delay = f"{quantiles(totals).p50_ms:.2f} ms" if totals else "-"
    errors = int(health.get("link_checksum_errors", 0)) + int(health.get("link_malformed", 0))
    frames = f"{health.get('link_messages_out', '-')} out {health.get('link_messages_in', '-')} in {errors} bad"
    return (
        f"{elapsed:6.1f} s  {share:4.0%}  N {north:5.1f} E {east:5.1f} depth {depth:4.2f} m  {truth.nu[0]:4.2f} m/s  "
        f"real time x{health.get('real_time_factor', '-')}  delay {delay}  link {frames}"
    )
