"""The interface of every autopilot: sensor samples in, pulse widths out, and lines for a person.

    autopilot.update_sensor(topic, sample)     every sample, as it comes from the simulation
    autopilot.advance(time_ns, truth)          after each step of the simulation: sends what the autopilot waits for
    autopilot.receive(now)                     after its descriptor became readable: the newest outputs
    autopilot.may_step()                       in lockstep: whether the autopilot has answered the last step

Time in `advance` is simulation time; `now` is always the monotonic clock.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple

from hil.common.clock import NS_PER_S
from sim.sensors.samples import OdometrySample

CHECK_NS = NS_PER_S // 10  # between two checks
STALL_NS = NS_PER_S  # without an answer in lockstep: said once
SILENT_NS = NS_PER_S // 5  # without outputs: thrusters neutral, as PX4's own simulators do
ABSENT_NS = 10 * NS_PER_S  # without any sign of an autopilot: reported once, and again after that time

Report = Callable[[str], None]


class Outputs(NamedTuple):
    """The outputs that an autopilot requests.

    `pwm_us` are pulse widths in microseconds, one an output channel of the autopilot; 0 is no output. `armed` is None
    where the interface has none. `received_ns` (monotonic) is when they came in.
    """

    pwm_us: tuple[int, ...]
    armed: bool | None
    received_ns: int


class Figures:
    """Counters of one autopilot since it was opened."""

    __slots__ = ("duplicates", "lost", "malformed", "outputs", "resets", "stalls", "states")

    def __init__(self) -> None:
        self.outputs = 0  # packets with outputs that were taken
        self.states = 0  # sets of sensor values that were sent
        self.duplicates = 0  # outputs that came once more, as after a stall
        self.lost = 0  # outputs that are missing between two that came
        self.malformed = 0  # packets that are none of the interface, and were dropped
        self.resets = 0  # starts of the autopilot after the first
        self.stalls = 0  # times that lockstep waited longer than STALL_NS


class Autopilot(ABC):
    """One flight controller. `name` is its kind and address for messages, `figures` its counters.

    `lockstep` is true where simulated time waits for its answers.
    """

    name: str
    lockstep: bool
    figures: Figures

    @abstractmethod
    def fileno(self) -> int:
        """Return the descriptor to wait on for outputs."""

    @property
    @abstractmethod
    def connected(self) -> bool:
        """Return whether it has sent outputs, and has not been lost since."""

    @abstractmethod
    def update_sensor(self, topic: str, sample: Any) -> None:
        """Take one sensor sample (NED, FRD)."""

    @abstractmethod
    def advance(self, time_ns: int, truth: OdometrySample) -> None:
        """Send what is due now that a step has ended at simulation time `time_ns`. Raises DeviceError."""

    @abstractmethod
    def receive(self, now: int) -> Outputs | None:
        """Return the newest outputs that came since the last call; None without new ones. Raises DeviceError."""

    @abstractmethod
    def may_step(self) -> bool:
        """Return whether the next step may go: always, unless lockstep waits for an answer."""

    def patience_ns(self) -> int:
        """Return how long to wait at most for its descriptor before `may_step` is asked again."""
        return CHECK_NS

    @abstractmethod
    def check(self, now: int) -> None:
        """Report what is wrong at `now`: nobody there, a stall, an answer that does not come."""

    @abstractmethod
    def close(self) -> None:
        """Close the connection. Closing twice is harmless."""


def is_output(pwm_us: int) -> bool:
    """Return whether this is a pulse width for a motor controller; 0 and all others are no output."""
    return 800 <= pwm_us <= 2200
