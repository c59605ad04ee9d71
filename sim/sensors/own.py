"""A user's own sensor: a class that the scenario names, with the common keys and its own arguments.

    [sensors.thermometer]
    class = "my_sensors:Thermometer"
    rate = "2 Hz"
    position = [0.3, 0.0, 0.1]
    surface = 18.0

Its samples are published on the topic of the section's name, in ROS messages of the type that the class states.
"""

from collections.abc import Mapping
from random import Random
from typing import Annotated, Any, NamedTuple, Protocol

from hil.common.errors import ConfigError
from hil.common.plugins import load_class
from hil.common.schema import Range, parse
from sim.dynamics import State
from sim.sensors.error import sensor_random
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene

Values = Mapping[str, Any]


class OwnSensor(Protocol):
    """Interface of a user's sensor. `message` is the ROS type of its messages, e.g. "sensor_msgs/msg/Temperature".

    An object is made for each simulation. It must depend only on its arguments, or a run cannot be repeated: random
    numbers must come from `random`.
    """

    message: str

    def begin(self, scene: Scene, mounting: Mounting, random: Random) -> None:
        """Begin a simulation. `scene` is what can be measured, `random` has the sensor's own random numbers."""

    def sample(self, time_ns: int, state: State) -> Values | None:
        """Return the measurement at `time_ns` of simulation time; None if there is none.

        `state.position` is NED in m, `state.quaternion` body to world, `state.nu` m/s and rad/s in FRD. The result has
        the fields of the message that are not 0, in ROS's units and frames: {"temperature": 17.5}. A missing header is
        filled in.
        """


class OwnSample(NamedTuple):
    """The fields of one message, and the time of the measurement."""

    time_ns: int
    values: Values


class OwnModel(NamedTuple):
    """The keys of a user's sensor. `table` has those of its class, `where` is the file and section, for errors."""

    rate: Annotated[float, Range(0.0, 1000.0, "Hz")]
    table: Mapping[str, Any] = {}
    where: str = ""


class OwnKind:
    """Factory of a user's sensor that publishes messages of the type `message` on `topic`."""

    offloaded = False
    Model = OwnModel

    def __init__(self, topic: str, message: str) -> None:
        self.topic = topic
        self.message = message

    def __call__(self, model: OwnModel, mounting: Mounting, seed: int, scene: Scene) -> "_ScheduledSensor":
        """Return the sensor of one simulation."""
        sensor = _build(model.table, model.where)
        sensor.begin(scene, mounting, sensor_random(seed, self.topic))
        return _ScheduledSensor(sensor)


class _ScheduledSensor:
    """Adapts a user's sensor to the interface `Sensor`."""

    def __init__(self, sensor: OwnSensor) -> None:
        self._sensor = sensor

    def sample(self, time_ns: int, state: State) -> OwnSample | None:
        """Return the measured values with their time; None if there are none."""
        values = self._sensor.sample(time_ns, state)
        return None if values is None else OwnSample(time_ns, values)


def check_name(name: str, where: str) -> None:
    """Check that a sensor's name is valid as a topic's name. Raises ConfigError."""
    if not name.isidentifier() or not name.isascii():
        raise ConfigError(f"{where}: a sensor's name becomes a topic's: letters, digits and _, no digit first")


def read_own(name: str, section: Mapping[str, Any], where: str) -> tuple[Any, OwnModel, Mounting]:
    """Read the section of a user's sensor; return its factory, keys and mounting. Raises ConfigError."""
    check_name(name, where)
    mounting_keys = {key: value for key, value in section.items() if key in Mounting._fields}
    sensor_keys = {key: value for key, value in section.items() if key not in (*Mounting._fields, "rate")}
    if "rate" not in section:
        raise ConfigError(f"{where}: key 'rate' is missing")
    rate = parse({"rate": section["rate"]}, OwnModel, where).rate
    message = getattr(_build(sensor_keys, where), "message", None)
    if not isinstance(message, str):
        raise ConfigError(f'{where}: {sensor_keys["class"]} has no attribute `message`, such as "std_msgs/msg/Float64"')
    return OwnKind(name, message), OwnModel(rate, sensor_keys, where), parse(mounting_keys, Mounting, where)


def _build(table: Mapping[str, Any], where: str) -> OwnSensor:
    sensor: OwnSensor = load_class(dict(table), OwnSensor, where, "sensors")
    return sensor
