"""The host's end of a link whose far end is a test: nothing comes but what the test says."""

from collections.abc import Callable
from typing import Any, cast

from hil.common.clock import NEVER_NS
from hil.common.errors import DeviceError
from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from hil.slave.drivers.ends import Ends


class BenchLink:
    """Link that receives what is put into `says`; `broken` is a pulled cable; `closed` is true once it is closed."""

    deadline_ns = NEVER_NS

    def __init__(self) -> None:
        self.says: list[ThrusterTelemetry] = []
        self.broken = self.closed = False
        self.wire = self

    def fileno(self) -> int:
        return -1

    def tick(self, _now: int) -> None:
        if self.broken:
            raise DeviceError("gone")

    def receive(self) -> list[ThrusterTelemetry]:
        output, self.says = self.says, []
        return output

    def send(self, command: ThrusterCommand) -> None:
        pass

    def close(self) -> None:
        self.closed = True

    def ends(self) -> Ends:
        return Ends("/dev/bench", cast(Any, self))


def says_in_turn(reports: list[ThrusterTelemetry]) -> Callable[[], Ends]:
    """Open a link on which one of `reports` comes at each look."""
    link = BenchLink()
    cast(Any, link).receive = lambda: [reports.pop(0)]
    return link.ends
