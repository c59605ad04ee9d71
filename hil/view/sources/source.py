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
        """Return the time that can be paused and sped up; None of vehicles that live in real time."""

    @property
    def recorder(self) -> "ViewRecorder | None":
        """Return what records the vehicles when a person asks for it; None where there is nothing to record."""

    @property
    def names(self) -> list[str]:
        """Names of the vehicles there are, sorted; those that are lost included."""

    def is_present(self, name: str) -> bool:
        """Return True if samples of that vehicle come."""

    def latest(self, name: str) -> Mapping[str, Any]:
        """Return the newest message of each topic, as its decoder in hil.ros returns it: NED, FRD, SI units."""

    def diagnostics(self, name: str) -> "Diagnostics":
        """Return the figures of health; empty before the first."""

    def vehicle(self, name: str) -> "Vehicle | None":
        """Return what commands that vehicle; None where nobody may."""

    def delays_ms(self, name: str) -> tuple[list[float], dict[str, float]]:
        """Return the delays (ms) of the newest commands, and the median (ms) of each hop; empty if not known."""

    def show_pictures(self, wanted: bool) -> None:
        """Receive pictures of cameras and sonars from now on, or not any more."""

    def log_lines(self) -> list[str]:
        """Return what happened since the last call, a line each."""
