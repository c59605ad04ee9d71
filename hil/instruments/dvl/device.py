"""What clients read and set of a DVL A50 or A125, whatever their format."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

from hil.common.clock import NEVER_NS, NS_PER_S
from hil.common.schema import Range
from hil.instruments.contract import Client, Facts, Instrument, Scene, Send
from hil.instruments.dvl.report import Config, DeadReckoning, Report
from hil.instruments.streams import Lines

MOST_TRIGGERS = 15
CALIBRATION_NS = 5 * NS_PER_S  # ours: "up to 15 s"
Format = Literal["json", "pd6", "pd4"]


class DvlSettings(NamedTuple):
    """Settings of a DVL A50 or A125: its configuration when it is new, and its software.

    `formats` are those of its TCP wires, in their order (default: JSON for all). `serial_protocol` is the number of
    `wcp`: 0 nothing, 1 and 3 lines with and without the old sentences, 2 PD6, 6 PD4. What clients set outlives a loss
    of power, but not the process.
    """

    speed_of_sound: Annotated[float, Range(1000.0, 2000.0, "m/s")] = 1500.0
    mounting_rotation_offset: Annotated[float, Range(0.0, 360.0)] = 0.0
    acoustic_enabled: bool = True
    dark_mode_enabled: bool = False
    range_mode: str = "auto"
    periodic_cycling_enabled: bool = True
    formats: tuple[Format, ...] = ()
    serial_protocol: Annotated[int, Range(0, 6)] = 1
    software: Literal["2.6.1", "2.7.1"] = "2.7.1"

    def validate(self) -> str | None:
        """Return why the range mode is invalid, or None."""
        return Config(range_mode=self.range_mode).validate()


@dataclass
class Kept:
    """What the device keeps without power: its configuration, and the number of the format on serial lines."""

    config: Config
    serial_protocol: int


class DvlDevice(Instrument):
    """The state that the commands of all formats read and change."""

    Model = DvlSettings
    product = ""

    def __init__(self, settings: DvlSettings, facts: Facts, scene: Scene, send: Send) -> None:
        super().__init__(settings, facts, scene, send)
        config = Config(*[getattr(settings, key) for key in Config._fields])
        self.kept: Kept = facts.memory.setdefault("kept", Kept(config, settings.serial_protocol))
        self.reckoning = DeadReckoning()
        self.orientation = (1.0, 0.0, 0.0, 0.0)  # of the sensor's axes, NED
        self.triggers = 0  # pings that wait
        self.calibrations: deque[tuple[int, Callable[[], None]]] = deque()  # when they end, and what then

    def reset_reckoning(self) -> None:
        """Begin dead reckoning again."""
        self.reckoning = DeadReckoning()
        self.reckoning.turn(self.orientation, self.kept.config.mounting_rotation_offset)

    def trigger(self) -> bool:
        """Queue a ping; return False if the queue is full."""
        is_free = self.triggers < MOST_TRIGGERS
        self.triggers += is_free
        return is_free

    def calibrate(self, now_ns: int, done: Callable[[], None]) -> None:
        """Calibrate the gyroscope, which takes its time; then call `done`."""
        self.calibrations.append((now_ns + CALIBRATION_NS, done))


class DvlWire(ABC):
    """The format of one client of the DVL `dvl`. By default it has no commands and no dead reckoning."""

    longest = 65_536  # bytes of a line

    def __init__(self, dvl: DvlDevice, client: Client) -> None:
        self._dvl, self._client = dvl, client
        self._lines = Lines(self.longest)

    def feed(self, data: bytes, now_ns: int) -> None:  # noqa: B027
        """Take bytes of the client. Never raises."""

    @abstractmethod
    def report(self, report: Report, now_ns: int) -> bytes:
        """Return a ping's bytes."""

    def position(self, now_ns: int) -> bytes:
        """Return the bytes of a dead reckoning report."""
        return b""

    def tick(self, now_ns: int) -> int:
        """Do what is due; return when (ns) the next is."""
        return NEVER_NS
