"""The interface of an autopilot: sensor samples in, pulse widths out, and reports to the user.

    autopilot.update_sensor(topic, sample)     store a sample of the simulation; called for each
    autopilot.advance(time_ns, truth)          send the state or sensor messages; called after each simulation step
    autopilot.receive(now)                     return the newest outputs; called when its descriptor is readable
    autopilot.may_step()                       in lockstep: return whether the autopilot has replied to the last step

Time in `advance` is simulation time; `now` is always the monotonic clock (ns).
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from math import degrees, isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

from hil.common.clock import NS_PER_S
from sim.sensors.samples import OdometrySample

if TYPE_CHECKING:
    from hil.autopilots.inputs import SensorInputs
    from hil.ros.diagnostics import Diagnostics

CHECK_NS = NS_PER_S // 10  # between two calls of `check`
STALL_NS = NS_PER_S  # without a reply in lockstep, after which a stall is reported
SILENT_NS = NS_PER_S // 5  # without outputs, after which thrusters are neutral, as in PX4's own simulators
ABSENT_NS = 10 * NS_PER_S  # without a connected autopilot, after which that is reported, again and again

Report = Callable[[str], None]


class Outputs(NamedTuple):
    """Outputs of an autopilot.

    `pwm_us`: pulse widths (us), one per output channel of the autopilot; 0 is no output. `armed`: None if the interface
    does not transmit it. `received_ns`: time of arrival (monotonic).
    """

    pwm_us: tuple[int, ...]
    armed: bool | None
    received_ns: int


class EstimateError(NamedTuple):
    """An autopilot's estimate minus the truth: angles in rad, distance of the position in m, nan until it has one."""

    roll: float
    pitch: float
    yaw: float
    position: float

    def add_figures(self, figures: "Diagnostics") -> None:
        """Add the errors to the diagnostics, those that are known."""
        figures.autopilot_roll_error_deg = degrees(self.roll)
        figures.autopilot_pitch_error_deg = degrees(self.pitch)
        figures.autopilot_yaw_error_deg = degrees(self.yaw)
        if isfinite(self.position):
            figures.autopilot_position_error_m = self.position


class AutopilotCounters:
    """Counters of one autopilot since it was opened."""

    __slots__ = ("duplicates", "lost", "malformed", "outputs", "resets", "stalls", "states")

    def __init__(self) -> None:
        self.outputs = 0  # packets with outputs, accepted
        self.states = 0  # sets of sensor values sent
        self.duplicates = 0  # packets with outputs received again, for example after a stall
        self.lost = 0  # packets with outputs that did not arrive, and messages that could not be sent
        self.malformed = 0  # packets not of this interface, dropped
        self.resets = 0  # restarts of the autopilot
        self.stalls = 0  # times that the autopilot stopped replying for longer than STALL_NS


class Autopilot(ABC):
    """Connection to one flight controller. `name`: kind and address, for reports. `figures`: its counters.

    `lockstep`: simulation time waits for its replies. `sent_ns`: when the newest state was given to the system to send.
    """

    name: str
    lockstep: bool
    figures: AutopilotCounters
    sent_ns = 0
    _inputs: "SensorInputs"

    @property
    def estimate(self) -> EstimateError | None:
        """The error of the autopilot's newest estimate; None if it is not known."""
        return None

    @abstractmethod
    def fileno(self) -> int:
        """Return the descriptor to wait on for outputs."""

    @property
    @abstractmethod
    def connected(self) -> bool:
        """Return whether the autopilot is connected, and has not stopped sending."""

    def update_sensor(self, topic: str, sample: Any) -> None:
        """Store one sensor sample (NED, FRD)."""
        self._inputs.update(topic, sample)

    @abstractmethod
    def advance(self, time_ns: int, truth: OdometrySample) -> None:
        """Send the messages due at simulation time `time_ns`, the end of a step. Raises DeviceError."""

    @abstractmethod
    def receive(self, now: int) -> Outputs | None:
        """Return the newest outputs received since the last call, None if there are none. Raises DeviceError."""

    @abstractmethod
    def may_step(self) -> bool:
        """Return whether the next step may be made: False only while lockstep waits for a reply."""

    def wait_limit_ns(self) -> int:
        """Return how long to wait at most for its descriptor before calling `may_step` again."""
        return CHECK_NS

    @abstractmethod
    def check(self, now: int) -> None:
        """Report faults at `now`: no autopilot connected, a stall, or data that cannot be read."""

    @abstractmethod
    def close(self) -> None:
        """Close the connection. Closing twice is harmless."""


def is_output(pwm_us: int) -> bool:
    """Return whether this is a pulse width (us) for a motor controller; 0 and other values mean no output."""
    return 800 <= pwm_us <= 2200
