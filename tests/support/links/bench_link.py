"""The host's end of a link whose other end is a test, which supplies all reports."""

from collections.abc import Callable
from typing import Any, cast

from hil.common.clock import NEVER_NS
from hil.common.errors import DeviceError
from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from hil.slave.drivers.ends import Ends


class BenchLink:
    """A link that receives the content of `reports`; `broken` is a pulled cable; `closed` is true once it is closed."""

    deadline_ns = NEVER_NS
    pace = None

    def __init__(self) -> None:
        self.reports: list[ThrusterTelemetry] = []
        self.broken = self.closed = False
        self.wire = self

    def fileno(self) -> int:
        return -1

    def tick(self, _now: int) -> None:
        if self.broken:
            raise DeviceError("gone")

    def receive(self) -> list[ThrusterTelemetry]:
        output, self.reports = self.reports, []
        return output

    def send(self, command: ThrusterCommand) -> None:
        pass

    def close(self) -> None:
        self.closed = True

    def bench_ends(self) -> Ends:
        return Ends("/dev/bench", cast(Any, self))


def link_with_reports(reports: list[ThrusterTelemetry]) -> Callable[[], Ends]:
    """Open a link that receives one of `reports` at each call."""
    link = BenchLink()
    cast(Any, link).receive = lambda: [reports.pop(0)]
    return link.bench_ends
