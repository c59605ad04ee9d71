"""Show the progress of a mission on the terminal and write it to a log."""

import sys
import time
from collections.abc import Callable
from contextlib import suppress

from hil.client.client import VehicleClient
from hil.client.delay import quantiles
from hil.common.columns import fit_to_terminal, shorten_status
from hil.ros.diagnostics import to_text
from sim.sensors.samples import OdometrySample

TERMINAL_PERIOD_S = 0.2
LINE_PERIOD_S = 5.0


class Progress:
    """Show one line that is updated on a terminal, else a line every five seconds. Write all lines to a log as well.

    With `report` nothing is printed: `report` is called with the elapsed time and the share done instead.
    """

    def __init__(self, log_path: str, report: Callable[[str], None] | None = None) -> None:
        self._log = open(log_path, "w", encoding="utf-8")  # noqa: SIM115 - closed by close()
        self._logged_s = 0.0
        self._report = report
        self._terminal = sys.stdout.isatty()
        self._period_s = TERMINAL_PERIOD_S if self._terminal else LINE_PERIOD_S
        self._next_s = 0.0
        self._open_line = False
        self._printed_s = -LINE_PERIOD_S

    def print_line(self, text: str) -> None:
        """Print a line."""
        if self._open_line:
            print()
            self._open_line = False
        if self._report is None:
            print(fit_to_terminal(text), flush=True)
        self._write(text)

    def close(self) -> None:
        """Close the log."""
        with suppress(OSError):  # the disk is full: lines written before remain
            self._log.close()

    def _write(self, line: str) -> None:
        with suppress(OSError):  # the mission continues without the log
            self._log.write(line + "\n")

    def print_limited(self, text: str) -> None:
        """Print a line, at most one a second."""
        now = time.monotonic()
        if now - self._printed_s > 1.0:
            self._printed_s = now
            self.print_line(text)

    def show(self, elapsed: float, truth: OdometrySample, share: float, client: VehicleClient) -> None:
        """Show the state of the run, if the period has passed since the last time."""
        if self._report:
            self._report(f"{elapsed:.1f} s, {share:.0%}")
        if elapsed < self._next_s:
            return
        self._next_s = elapsed + self._period_s
        line = _line(elapsed, truth, share, client)
        if elapsed >= self._logged_s:
            self._logged_s = elapsed + 1.0
            self._write(line)
        if self._report:
            return
        if self._terminal:
            print("\r\x1b[K" + shorten_status(line), end="", flush=True)
            self._open_line = True
        else:
            print(line, flush=True)


def _line(elapsed: float, truth: OdometrySample, share: float, client: VehicleClient) -> str:
    north, east, depth = truth.position
    health = client.diagnostics()
    totals = client.delays.totals_ns(newest=100)
    delay = f"{quantiles(totals).p50_ms:.2f} ms" if totals else "-"
    errors = (health.link_checksum_errors or 0) + (health.link_malformed or 0)
    frames = f"{to_text(health.link_messages_out)} out {to_text(health.link_messages_in)} in {errors} bad"
    return (
        f"{elapsed:6.1f} s  {share:4.0%}  N {north:5.1f} E {east:5.1f} depth {depth:4.2f} m  {truth.nu[0]:4.2f} m/s  "
        f"delay {delay}  real time x{to_text(health.real_time_factor, '.4f')}  link {frames}"
    )
