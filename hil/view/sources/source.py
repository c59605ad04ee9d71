"""Interface of the live view's sources: the newest samples of each vehicle."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from hil.client.vehicle_handle import Vehicle
    from hil.ros.diagnostics import Diagnostics
    from hil.view.sources.paced_time import PacedTime
    from hil.view.sources.recording import ViewRecorder


class Source(Protocol):
    """The samples of some vehicles."""

    @property
    def playback(self) -> "PacedTime | None":
        """Return the time that can be paused and sped up; None for vehicles in real time."""

    @property
    def recorder(self) -> "ViewRecorder | None":
        """Return the recorder of the vehicles; None if this source cannot be recorded."""

    @property
    def names(self) -> list[str]:
        """Names of all vehicles, sorted, including those that are lost."""

    def is_present(self, name: str) -> bool:
        """Return True if the vehicle is sending samples."""

    def latest(self, name: str) -> Mapping[str, Any]:
        """Return the newest message of each topic, as its decoder in hil.ros returns it: NED, FRD, SI units."""

    def diagnostics(self, name: str) -> "Diagnostics":
        """Return the newest diagnostics; empty before the first."""

    def vehicle(self, name: str) -> "Vehicle | None":
        """Return the handle that commands that vehicle; None if it cannot be commanded."""

    def delays_ms(self, name: str) -> tuple[list[float], dict[str, float]]:
        """Return the delays (ms) of the newest commands, and the median (ms) of each hop; empty if not known."""

    def show(self, viewed: bool, with_pictures: bool) -> None:
        """Receive what is drawn: all samples if a browser is connected, and then pictures of cameras and sonars too."""

    def log_lines(self) -> list[str]:
        """Return what happened since the last call, a line each."""


class OfflineSource:
    """Base of sources without a network: nobody commands the vehicles, and there are no delays and no log."""

    def vehicle(self, _name: str) -> None:
        """Return None, as the recording or the planner of the simulation decides what the vehicle does."""
        return

    def delays_ms(self, _name: str) -> tuple[list[float], dict[str, float]]:
        """Return no delays."""
        return [], {}

    def show(self, viewed: bool, with_pictures: bool) -> None:
        """Do nothing, as all samples are there anyway."""

    def log_lines(self) -> list[str]:
        """Return no lines."""
        return []
