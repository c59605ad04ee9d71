"""The control laws: a common contract for all, each against values by hand, then how a vehicle file chooses one."""

import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.autonomy.control.controller import (
    NO_RESIDUAL,
    AxisGains,
    CascadedController,
    Gains,
    Navigation,
    VelocityCommand,
    Wrench,
)
from hil.autonomy.control.families import Controller, make_controller
from hil.autonomy.control.fin_control import FinController, FinGains
from hil.autonomy.control.model import Plant
from hil.common.errors import ConfigError
from hil.slave.plant_model import plant_of
from hil.tuning.rig import Rig
from sim.dynamics import Dynamics, State
from sim.rotations import from_euler, matrix
from sim.vehicle.vehicle import load_vehicle
from tests.support.flights.controller_contract import AT_REST, DT, ControllerContract

INERTIA: Wrench = (19.9, 20.6, 32.2, 0.45, 0.37, 0.59)
HEAVY = Plant(
    INERTIA, (13.7, 0.0, 33.0, 0.0, 0.8, 0.0), (141.0, 217.0, 190.0, 1.2, 0.5, 1.5), 132.0, 131.0,
    center_of_buoyancy=(0.0, 0.0, -0.01),
)  # fmt: skip
SLEWED = Gains()._replace(surge=AxisGains(p=4.0, i=6.0, limit=5.0, slew=2.0), yaw_rate=AxisGains(4.0, d=0.5, slew=50.0))


def limits(*accelerations: float) -> Wrench:
    x, y, z, k, m, n = (a * b for a, b in zip(accelerations, INERTIA, strict=True))
    return x, y, z, k, m, n


class TestCascade(ControllerContract):
    limits = limits(10.0, 10.0, 10.0, 20.0, 20.0, 20.0)

    def make(self) -> Controller:
        return CascadedController(Gains(), INERTIA)


class TestSlewedCascade(ControllerContract):
    limits = limits(5.0, 10.0, 10.0, 20.0, 20.0, 10.0)

    def make(self) -> Controller:
        return CascadedController(SLEWED, INERTIA)


class TestFins(ControllerContract):
    """The rest of the contract for a torpedo, which has no sway and no heave, and does not go slowly astern."""

    limits = limits(10.0, 0.0, 0.0, 20.0, 20.0, 20.0)
    pushes = ((0, 1.0),)

    def make(self) -> Controller:
        return FinController(Gains(), FinGains(), INERTIA)

    @pytest.mark.parametrize("sign", [1.0, -1.0])
    def test_a_fin_vehicle_reaches_heading_and_depth(self, sign: float) -> None:
        """A torpedo dives by its pitch, bow down."""
        moving = AT_REST._replace(velocity=(1.0, 0.0, 0.0))
        wrench = self.make().update(VelocityCommand(surge=1.0, heading=sign * 0.5, depth=5.0 + sign), moving, DT)
        assert sign * wrench[5] > 0.0
        assert sign * wrench[4] < 0.0


def test_a_fin_vehicle_commanded_to_heading_0_or_depth_0_keeps_moving() -> None:
    """A set point of 0 counts as a set point."""
    for command in (VelocityCommand(heading=0.0), VelocityCommand(depth=0.0)):
        assert TestFins().make().update(command, AT_REST, DT)[0] > 0.0
    assert TestFins().make().update(VelocityCommand(), AT_REST, DT)[0] == 0.0


# -- slew ---------------------------------------------------------------------------------------------------------


@given(st.lists(st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(1e-3, 0.1)), min_size=1, max_size=30))
def test_the_output_never_changes_faster_than_the_slew_rate(calls: list[tuple[float, float, float]]) -> None:
    controller, last = CascadedController(SLEWED, INERTIA), 0.0
    for surge, speed, dt in calls:
        force = controller.update(VelocityCommand(surge=surge), AT_REST._replace(velocity=(speed, 0.0, 0.0)), dt)[0]
        assert abs(force - last) <= 2.0 * dt * INERTIA[0] * (1.0 + 1e-9) + 1e-9
        last = force


def test_the_slew_ramp_is_that_worked_out_by_hand_without_windup() -> None:
    """A requested 4 m/s² at 2 m/s³ is reached by 0.04 m/s² more each 20 ms, with the integral constant until then."""
    gains = Gains()._replace(surge=AxisGains(p=4.0, i=6.0, slew=2.0))
    controller = CascadedController(gains, INERTIA)
    forces = [controller.update(VelocityCommand(surge=1.0), AT_REST, DT)[0] / INERTIA[0] for _ in range(120)]
    assert forces[:100] == pytest.approx([0.04 * (number + 1) for number in range(100)])
    first = AxisGains(p=4.0).p + 6.0 * DT  # the first call integrates: nothing is behind yet
    assert forces[102] == pytest.approx(first, abs=6.0 * 3 * DT)
    assert CascadedController(gains, INERTIA).update(VelocityCommand(), AT_REST, DT)[0] == 0.0


# -- the model ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["bluerov2_heavy", "paper_six", "bluerov2"])
def test_the_model_load_equals_the_simulators_forces(name: str) -> None:
    """The load equals the simulator's drag, weight, lift and Coriolis, term by term, in a state of no symmetry."""
    vehicle, _ = load_vehicle(name)
    plant = plant_of(vehicle, 1025.0, 9.81)
    attitude = from_euler(0.3, -0.4, 1.0)
    nu = (0.4, -0.2, 0.1, 0.2, -0.3, 0.5)
    forces = Dynamics(vehicle, 1025.0, 9.81).forces(State((0.0, 0.0, 20.0), attitude, nu), NO_RESIDUAL, (0.0, 0.0, 0.0))
    assert plant.restoring(attitude) == pytest.approx([-x for x in forces.restoring], abs=1e-9)
    if vehicle.center_of_gravity == (0.0, 0.0, 0.0):  # else the mass matrix is not diagonal
        assert plant.coriolis(nu) == pytest.approx([-x for x in forces.coriolis], abs=1e-9)
        assert plant.load(Navigation(attitude, nu[3:], nu[:3], 20.0), nu) == pytest.approx([-x for x in forces.total])
    assert matrix(attitude)[8] < 0.95


def test_fin_vehicles_accept_the_cascade_only() -> None:
    vehicle, control = load_vehicle("lauv")
    with pytest.raises(ConfigError, match="lauv: control: family: a vehicle with fins is steered by the cascade"):
        Rig("lauv", vehicle, {**control, "family": "mine:Law"})


OWN = """
class Bang:
    def __init__(self, plant, gains, force):
        self.force = force

    def reset(self):
        pass

    def update(self, command, navigation, dt, residual=(0.0,) * 6):
        side = 1.0 if command.surge > navigation.velocity[0] else -1.0
        return (self.force if side > 0.0 else -self.force, 0.0, 0.0, 0.0, 0.0, 0.0)
"""


def test_a_control_law_can_be_a_users_class(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_bang_law.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    control = {"family": "my_bang_law:Bang", "options": {"force": 7.0}}
    law = make_controller("my_bang_law:Bang", control, Gains(), HEAVY, "v.toml: control")
    assert law.update(VelocityCommand(surge=0.5), AT_REST, DT)[0] == 7.0
    with pytest.raises(ConfigError, match="does not take these keys"):
        make_controller("my_bang_law:Bang", {"options": {"farce": 7.0}}, Gains(), HEAVY, "v.toml: control")
    for force in (float("nan"), "much"):
        law = make_controller("my_bang_law:Bang", {"options": {"force": force}}, Gains(), HEAVY, "v.toml: control")
        with pytest.raises(ConfigError, match=r"my_bang_law:Bang: update gave .* six finite numbers"):
            law.update(VelocityCommand(surge=0.5), AT_REST, DT)
