"""A wrong type passed to a simulation is refused with one error that names it."""

from math import nan
from typing import Any

import pytest

from hil.common.errors import ConfigError
from sim.environment.world import load_world
from sim.simulation import Simulation
from sim.vehicle.failures import Failure
from sim.vehicle.vehicle import load_vehicle

SIX, _ = load_vehicle("paper_six")
NAME = SIX.thrusters[0].name
POOL = load_world("pool")
PLACE, NEUTRAL = (4.0, 4.0, 2.0), [1500] * 6
BAD_KIND: Any = "bad"
TEXT: Any = "x"
NUMBER: Any = 3
NO_SPECS: list[Any] = [5, {}, None]


class NoWrench:
    """A force that returns an invalid wrench."""

    def __init__(self, returned: Any) -> None:
        self._returned = returned

    def begin(self, time_ns: int) -> None:
        pass

    def wrench(self, *_: object) -> Any:
        return self._returned


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        *[({"vehicle": given}, "vehicle = .*: give a Vehicle") for given in ("paper_six", None)],
        *[({"world": given}, "world = .*: give a World") for given in ("pool", None)],
        *[({"sensors": given}, "sensors = .*: give SensorSpec by name") for given in (5, "imu", ["imu"])],
        *[({"sensors": {"imu": given}}, "sensors: imu is .*: give a SensorSpec") for given in NO_SPECS],
        *[({"forces": given}, "forces = .*: give a list of objects") for given in (5, "x", NoWrench(None), {"x": 1})],
        *[({"forces": [given]}, r"forces\[0\] is .*: give an object with begin") for given in ("x", 5, NoWrench)],
        *[
            ({"failures": given}, "failures = .*: give a list of Failure records")
            for given in (5, "off", Failure(NAME, "off"))
        ],
        *[({"failures": [given]}, r"failures\[0\] is .*: give a Failure") for given in ("off", (NAME, "off"))],
        ({"failures": [Failure(NAME, BAD_KIND)]}, r"failures\[0\]: kind: 'bad' is not one of off"),
        ({"failures": [Failure(NAME, "efficiency", efficiency=nan)]}, r"failures\[0\]: efficiency: nan"),
        ({"failures": [Failure(NAME, "off", time=TEXT)]}, r"failures\[0\]: time: "),
        ({"failures": [Failure(NUMBER, "off")]}, r"failures\[0\]: thruster: expected text"),
        *[({"releases": given}, "releases = .*: give a list of Release records") for given in (5, "x")],
        *[({name: value}, f"{name}: nan") for name, value in (("position", (nan, 0.0, 0.0)), ("heading", nan))],
        *[({name: -1}, f"{name} = -1: ") for name in ("dt_ns", "seed")],
        ({"world": POOL._replace(gravity=nan)}, "gravity of pool: nan"),
        ({"releases": ["x"]}, r"releases\[0\] is x: give a Release"),
    ],
)
def test_a_simulation_refuses_other_types(arguments: dict[str, Any], message: str) -> None:
    vehicle = {"vehicle": SIX, "world": POOL, "position": PLACE, **arguments}
    with pytest.raises(ConfigError, match=f"^{message}"):
        Simulation(**vehicle)


@pytest.mark.parametrize("returned", [None, (1.0, 2.0), ("x",) * 6, (0.0,) * 7])
def test_a_force_that_returns_an_invalid_wrench_is_reported(returned: Any) -> None:
    simulation = Simulation(SIX, POOL, {}, position=PLACE, forces=[NoWrench(returned)])
    with pytest.raises(ConfigError, match=r"^the force .*:NoWrench returned .*: a wrench is six numbers"):
        simulation.step(NEUTRAL)
