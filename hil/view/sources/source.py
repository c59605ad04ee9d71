"""Interface of the live view's sources: the newest samples of each vehicle."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

from hil.common.errors import NetworkError

if TYPE_CHECKING:
    from hil.client.vehicle_handle import Vehicle
    from hil.ros.diagnostics import Diagnostics
    from hil.view.sources.paced_time import PacedTime
    from hil.view.sources.recording import ViewRecorder


class Source(ABC):
    """The samples of some vehicles. Without a network nobody commands them, and there are no delays and no log.

    `playback` is the time that can be paused and sped up, None for vehicles in real time; `recorder` records the
    vehicles, None if this source cannot be recorded; `taken` are the vehicles that were taken over here.
    """

    playback: "PacedTime | None" = None
    recorder: "ViewRecorder | None" = None
    taken: Collection[str] = ()

    @property
    @abstractmethod
    def names(self) -> list[str]:
        """Names of all vehicles, sorted, including those that are lost."""

    @abstractmethod
    def is_present(self, name: str) -> bool:
        """Return True if the vehicle is sending samples."""

    @abstractmethod
    def latest(self, name: str) -> Mapping[str, Any]:
        """Return the newest message of each topic, as its decoder in hil.ros returns it: NED, FRD, SI units."""

    @abstractmethod
    def diagnostics(self, name: str) -> "Diagnostics":
        """Return the newest diagnostics; empty before the first."""

    def vehicle(self, name: str) -> "Vehicle | None":
        """Return the handle that commands that vehicle; None if it cannot be commanded."""
        return None

    def take_over(self, name: str, on: bool) -> str:
        """Command the vehicle in place of another master, or give it back; return a text. Raises NetworkError."""
        raise NetworkError("this view only observes; start it without --observe to take a vehicle over")

    def delays_ms(self, name: str) -> tuple[list[float], dict[str, float]]:
        """Return the delays (ms) of the newest commands, and the median (ms) of each hop; empty if not known."""
        return [], {}

    def show(self, viewed: bool, with_pictures: bool) -> None:  # noqa: B027  # without a network all samples are there
        """Receive what is drawn: all samples if a browser is connected, and then pictures of cameras and sonars too."""

    def log_lines(self) -> list[str]:
        """Return what happened since the last call, a line each."""
        return []
