"""A battery monitor."""

from typing import Annotated, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import Range
from sim.dynamics import State
from sim.sensors.error import ErrorModel, sensor_random
from sim.sensors.extra_samples import BatterySample
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene
from sim.twins import make_error_bank


class BatteryMonitorModel(NamedTuple):
    """Rate in Hz (0: none) and errors in V and A.

    Steps: those of a 12-bit converter of 3.3 V behind Blue Robotics' Power Sense Module R2, which gives a volt for
    11 V and for 37.88 A (its manual). Noise of one step, and 1 % of scale, are our choice.
    """

    rate: Annotated[float, Range(0.0, 100.0, "Hz")] = 1.0
    voltage: ErrorModel = ErrorModel(noise=0.0089, scale=0.01, resolution=0.0089)
    current: ErrorModel = ErrorModel(noise=0.0305, scale=0.01, resolution=0.0305)


class BatteryMonitor:
    """The monitor of the vehicle's battery. Its count of the charge is exact; its drift is not modelled.

    Raises ConfigError for a vehicle without a battery.
    """

    Model = BatteryMonitorModel
    topic = "battery"

    def __init__(self, model: BatteryMonitorModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        vehicle = scene.vehicle
        if vehicle.battery is None:
            raise ConfigError(
                f"sensor 'battery': {vehicle.name} has no battery: give its vehicle file a [battery], "
                'and a thruster with curve = { kind = "t200" }'
            )
        self._capacity = vehicle.battery.capacity_ah
        self._scene = scene
        models = [model.voltage, model.current]
        self._errors = make_error_bank(models, 1.0 / model.rate, sensor_random(seed, self.topic))

    def sample(self, time_ns: int, state: State) -> BatterySample:
        """Return the present measurement."""
        battery = self._scene.battery
        assert battery is not None, "the constructor checks it"
        voltage, current = self._errors.measure((battery.voltage, battery.current))
        charge = battery.fraction * self._capacity
        return BatterySample(time_ns, voltage, current, charge, self._capacity, battery.cut_off)
