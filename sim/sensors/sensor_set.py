"""The sensors that a vehicle carries, and the schedule of their samples. Sections of a scenario:

[sensors.imu]                  # a default sensor, with other values
rate = "200 Hz"
latency = "5 ms"

[sensors.gps]                  # an additional sensor, with default values

[sensors.forward_sonar]
device = "oculus_m750d"        # values of sim/sensors/devices/oculus_m750d.toml, except those that are given here

[sensors.dvl]
rate = 0                       # without this sensor

[sensors.camera_down]
sensor = "camera"              # a second sensor of a kind; its topics and frames have its own name

[sensors.thermometer]
class = "my_sensors:Thermometer"  # a user's own sensor: sim/sensors/own.py
rate = "2 Hz"
"""

from collections.abc import Mapping
from importlib import import_module
from typing import Any, NamedTuple

from hil.common.clock import NEVER_NS
from hil.common.errors import ConfigError
from hil.common.schema import find_preset, nearest, parse_split, read_each
from hil.common.tables import read_table
from sim.sensors.error import sensor_random
from sim.sensors.kinds import SENSORS
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Sample, Scene, Sensor, period_ns

DEVICES = "sim/sensors/devices"
ONLY_ONE = ("odometry", "ground_truth")  # they report where the vehicle's origin is
DEFAULT_SENSORS = ("imu", "dvl", "pressure", "odometry", "ground_truth")


class SensorSpec(NamedTuple):
    """A sensor of a vehicle: its class, the record of its keys, its mounting, and the name of a second of a kind.

    `instrument` is for those who give it a wire; the simulation does not use it.
    """

    sensor: type[Sensor]
    model: Any
    mounting: Mounting = Mounting()
    name: str = ""
    instrument: Any = None

    @property
    def topic(self) -> str:
        """The topic of its samples: `name`, or the topic of its class without a name."""
        return self.name or self.sensor.topic

    def build(self, seed: int, scene: Scene) -> Sensor:
        """Return the sensor of one simulation; sensors of one kind have different random numbers."""
        named = type(self.sensor.__name__, (self.sensor,), {"topic": self.name}) if self.name else self.sensor
        mounting = self.mounting
        if mounting.misalignment:
            mounting = mounting.misaligned(sensor_random(seed, f"{self.topic}/misalignment"))
        sensor: Sensor = named(self.model, mounting, seed, scene)
        return sensor

    @property
    def offloaded(self) -> bool:
        """True if it is too slow for the loop of a slave, because it makes pictures, and runs in another process."""
        return bool(getattr(self.sensor, "offloaded", False) or getattr(self.model, "offloaded", False))


SensorSet = Mapping[str, SensorSpec]  # by the sensor's name


def read_sensors(sections: Any, where: str) -> SensorSet:
    """Return the sensors of the `[sensors]` table, and the default ones. Raises ConfigError."""
    if not isinstance(sections, dict):
        raise ConfigError(f"{where}: expected a table for each sensor, such as [sensors.imu]")
    names = [*sections, *(name for name in DEFAULT_SENSORS if name not in sections)]
    places = [(name, f"{where}: {name}") for name in names]
    read = read_each(places, lambda name, place: _read_sensor(name, sections.get(name, {}), place))
    specs: dict[str, Any] = dict.fromkeys(DEFAULT_SENSORS) | dict(zip(names, read, strict=True))
    return {name: each for name, each in specs.items() if each.model.rate}


def load_device(name: str) -> SensorSpec:
    """Return the sensor of a product, by the name or the path of its file (sim/sensors/devices). Raises ConfigError."""
    kind = read_table(find_preset(DEVICES, name, "device")).get("sensor")
    return _read_sensor(str(kind), {"device": name}, f"device {name}")


def select_sensors(**models: Any) -> SensorSet:
    """Return the default sensors, replaced or supplemented by `models`.

    Each argument is named after a sensor: the record of its keys, a SensorSpec, or None to leave it out.
    """
    chosen = {name: load_sensor(name).Model() for name in DEFAULT_SENSORS} | models
    present = {name: model for name, model in chosen.items() if model is not None}
    specs = {name: m if isinstance(m, SensorSpec) else SensorSpec(load_sensor(name), m) for name, m in present.items()}
    return {name: each for name, each in specs.items() if each.model.rate}


class Schedule:
    """Calls each sensor when it is due, and returns its samples when they arrive.

    A sensor is due at whole multiples of its period, so that there is no drift, and is called in the first step of
    `dt_ns` at or after that time. Raises ConfigError for a sensor that is faster than the steps.
    """

    def __init__(self, sensors: SensorSet, scene: Scene, seed: int, dt_ns: int) -> None:
        self._slots = [Slot(name, spec, scene, seed, dt_ns) for name, spec in sensors.items()]
        self._in_flight: list[tuple[int, int, str, Sample]] = []  # arrival, number, topic, sample
        self._number = 0
        self.due_ns = 0  # time of the next measurement or arrival

    def pop_due(self, now_ns: int, scene: Scene) -> list[tuple[str, Sample]]:
        """Return the samples that arrive by `now_ns`, with their topics."""
        arrived: list[tuple[str, Sample]] = []
        state = scene.state
        next_ns = NEVER_NS
        for slot in self._slots:
            due_ns = slot.due_ns
            if due_ns <= now_ns:
                slot.due_ns = due_ns = due_ns + slot.period_ns
                sample = slot.sensor.sample(now_ns, state)
                if slot.is_prompt and sample is not None:
                    arrived.append((slot.topic, sample))
                elif sample is not None and not slot.drops(now_ns):
                    self._send(slot, sample, now_ns, arrived)
            if due_ns < next_ns:
                next_ns = due_ns
        if self._in_flight:
            next_ns = min(next_ns, self._deliver(now_ns, arrived))
        self.due_ns = next_ns
        return arrived

    def _send(self, slot: "Slot", sample: Sample, now_ns: int, arrived: list[tuple[str, Sample]]) -> None:
        """Send a sample, which may take some time to arrive."""
        delay_ns = slot.delay_ns
        if not delay_ns:
            arrived.append((slot.topic, sample))
            return
        self._number += 1
        self._in_flight.append((now_ns + delay_ns, self._number, slot.topic, sample))
        self._in_flight.sort(key=_arrival)

    def _deliver(self, now_ns: int, arrived: list[tuple[str, Sample]]) -> int:
        """Deliver the samples that have arrived by now; return when the next one arrives (ns)."""
        while self._in_flight and self._in_flight[0][0] <= now_ns:
            _, _, topic, sample = self._in_flight.pop(0)
            arrived.append((topic, sample))
        return self._in_flight[0][0] if self._in_flight else NEVER_NS


def _arrival(entry: tuple[int, int, str, Sample]) -> tuple[int, int]:
    return entry[:2]


class Slot:
    """One sensor, the time at which it is due next, and the delays and losses of its samples."""

    __slots__ = (
        "_drop_out", "_dropping_ns", "_jitter_ns", "_latency_ns", "_random", "due_ns", "is_prompt", "period_ns",
        "sensor", "topic",
    )  # fmt: skip

    def __init__(self, name: str, spec: SensorSpec, scene: Scene, seed: int, dt_ns: int) -> None:
        self.period_ns = period_ns(spec.model.rate)
        if self.period_ns < dt_ns:
            raise ConfigError(
                f"sensor {name!r}: its rate is above {1e9 / dt_ns:g} Hz, the rate of the simulation; lower it, or "
                "shorten its step"
            )
        self.sensor = spec.build(seed, scene)
        self.topic = spec.topic
        self.due_ns = self.period_ns
        self._latency_ns = round(spec.mounting.latency * 1e9)
        self._drop_out = spec.mounting.drop_out
        self._dropping_ns = round(1e9 * spec.mounting.drop_out_from), round(1e9 * spec.mounting.drop_out_until)
        self._jitter_ns = round(spec.mounting.jitter * 1e9)
        self._random = sensor_random(seed, f"{name}/drop_out") if self._drop_out or self._jitter_ns else None
        # True if every sample arrives without delay and none is lost.
        delays = self._latency_ns or self._jitter_ns or hasattr(self.sensor, "delay_ns")
        self.is_prompt = not (delays or self._drop_out)

    @property
    def delay_ns(self) -> int:
        """Delay (ns) from the instant of the last sample to its arrival."""
        jitter_ns = round(self._jitter_ns * self._random.random()) if self._jitter_ns and self._random else 0
        return self._latency_ns + jitter_ns + int(getattr(self.sensor, "delay_ns", 0))

    def drops(self, now_ns: int) -> bool:
        """True if this sample is lost on its way."""
        first_ns, last_ns = self._dropping_ns
        if self._random is None or not self._drop_out:
            return False
        return first_ns <= now_ns < last_ns and self._random.random() < self._drop_out


def _read_sensor(name: str, section: Any, where: str) -> SensorSpec:
    if not isinstance(section, dict):
        several = f', and one more of it as [sensors.{name}_2] with sensor = "{name}"' if name in SENSORS else ""
        raise ConfigError(f"{where}: expected a table, such as [sensors.{name}]{several}")
    if name not in SENSORS and "class" not in section and "sensor" not in section:
        known = f"{nearest(name, list(SENSORS))}; there are: {_names()}"
        raise ConfigError(
            f'{where.removesuffix(f": {name}")}: no sensor {name!r}{known}; one more of a kind needs sensor = "KIND", '
            'such as "camera", one of your own class = "module:Class"'
        )
    if "sensor" in section and "class" not in section:  # which may have a key of that name
        kind, section = _kind_of(name, section, where)
        return _read_sensor(kind, section, where)._replace(name=name if name != kind else "")
    if name not in SENSORS:
        from sim.sensors.own import read_own  # most vehicles have none

        return SensorSpec(*read_own(name, section, where))
    if "device" in section:
        section = _with_device(name, section, where)
    sensor = load_sensor(name)
    for key, value in section.items():
        if isinstance(value, dict) and key not in sensor.Model._fields:
            several = f'one more {name} is a section of its own: [sensors.{name}_{key}] with sensor = "{name}"'
            raise ConfigError(f"{where}: no key {key!r}; {several}")
    mounting, model = parse_split(section, Mounting, sensor.Model, where)
    return SensorSpec(sensor, model, mounting)


def _kind_of(name: str, section: dict[str, Any], where: str) -> tuple[str, dict[str, Any]]:
    """Return the kind of the key `sensor`, and the section without it. Raises ConfigError."""
    kind = section["sensor"]
    if not isinstance(kind, str) or kind not in SENSORS:
        raise ConfigError(f"{where}: sensor: no {kind!r}{nearest(str(kind), list(SENSORS))}; there are: {_names()}")
    if name in SENSORS and name != kind:
        raise ConfigError(f"{where}: sensor: {name!r} is the name of another kind; give this {kind} another name")
    if kind in ONLY_ONE and name != kind:
        raise ConfigError(f"{where}: sensor: a vehicle has one {kind}: change [sensors.{kind}]")
    from sim.sensors.own import check_name  # most vehicles have one of each kind

    check_name(name, where)
    return kind, {key: value for key, value in section.items() if key != "sensor"}


def _with_device(name: str, section: dict[str, Any], where: str) -> dict[str, Any]:
    """Return the section with the keys of its `device`; its own keys have priority."""
    path = find_preset(DEVICES, str(section["device"]), f"{where}: device")
    device = read_table(path)
    if device.pop("sensor", None) != name:
        raise ConfigError(f"{where}: device: {path} is no {name}; its key `sensor` says what it is")
    device.pop("source", None)
    return device | {key: value for key, value in section.items() if key != "device"}


def load_sensor(name: str) -> type[Sensor]:
    """Return the class of one of the sensors in SENSORS."""
    module, _, attribute = SENSORS[name].place.partition(":")
    sensor: type[Sensor] = getattr(import_module(module), attribute)
    return sensor


def _names() -> str:
    return ", ".join(sorted(SENSORS))
