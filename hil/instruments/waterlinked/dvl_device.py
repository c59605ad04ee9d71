"""What clients read and set of a DVL A50 or A125, whatever their format."""

from collections import deque
from collections.abc import Callable
from typing import Annotated, Literal, NamedTuple

from hil.common.clock import NS_PER_S
from hil.common.schema import Range
from hil.instruments.contract import Facts, Instrument, Scene, Send
from hil.instruments.waterlinked.dvl_report import Config, DeadReckoning

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
        try:
            Config().changed({"range_mode": self.range_mode})
        except ValueError as error:
            return str(error)
        return None


class DvlDevice(Instrument):
    """The configuration, which the device keeps without power, and its commands."""

    Model = DvlSettings
    product = ""

    def __init__(self, settings: DvlSettings, facts: Facts, scene: Scene, send: Send) -> None:
        super().__init__(settings, facts, scene, send)
        self.software = settings.software
        self.reckoning = DeadReckoning()
        self.orientation = (1.0, 0.0, 0.0, 0.0)  # of the sensor's axes, NED
        self.triggers = 0  # pings that wait
        self.calibrations: deque[tuple[int, Callable[[], None]]] = deque()  # when they end, and what then

    @property
    def config(self) -> Config:
        """The configuration; the device keeps it without power."""
        new = Config(*[getattr(self.settings, key) for key in Config._fields])
        kept: Config = self.facts.memory.setdefault("config", new)
        return kept

    @config.setter
    def config(self, config: Config) -> None:
        self.facts.memory["config"] = config

    @property
    def serial_protocol(self) -> int:
        """The number of the format on serial lines; the device keeps it without power."""
        return int(self.facts.memory.setdefault("serial_protocol", self.settings.serial_protocol))

    @serial_protocol.setter
    def serial_protocol(self, number: int) -> None:
        self.facts.memory["serial_protocol"] = number

    def reset_reckoning(self) -> None:
        """Begin dead reckoning anew."""
        self.reckoning = DeadReckoning()
        self.reckoning.turn(self.orientation, self.config.mounting_rotation_offset)

    def trigger(self) -> bool:
        """Queue a ping; return False if the queue is full."""
        if self.triggers >= MOST_TRIGGERS:
            return False
        self.triggers += 1
        return True

    def calibrate(self, now_ns: int, done: Callable[[], None]) -> None:
        """Calibrate the gyroscope, which takes its time; then call `done`."""
        self.calibrations.append((now_ns + CALIBRATION_NS, done))
