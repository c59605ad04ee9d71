"""Top speeds: published reference values, and the speed that a simulated run settles at."""

from collections.abc import Callable, Sequence
from math import inf

import pytest

from hil.autonomy.control.allocation import Allocator, pseudo_inverse
from hil.common.schema import preset_names
from sim.dynamics import Dynamics, State
from sim.vehicle.body_lift import CrossFlow
from sim.vehicle.terminal_speed import AXES, AxisCapability, axis_capabilities, equipment_drag, terminal_speed
from sim.vehicle.thrusters.bank import wrench_matrix
from sim.vehicle.vehicle import Vehicle, load_vehicle

HEAVY, _ = load_vehicle("bluerov2_heavy")


def top_speeds(vehicle: Vehicle, density: float = 1000.0) -> tuple[AxisCapability, ...]:
    return axis_capabilities(vehicle, pseudo_inverse(wrench_matrix(vehicle))[0], density)


def test_the_terminal_speed_solves_its_equation() -> None:
    for force, *drag in ((5.0, 2.0, 3.0), (-5.0, 2.0, 3.0), (1e-9, 2.0, 3.0), (8.0, 2.0, 0.0), (8.0, 0.0, 2.0)):
        v = terminal_speed(force, *drag)
        assert drag[0] * v + drag[1] * v * abs(v) == pytest.approx(force, rel=1e-12)
    assert terminal_speed(0.0, 0.0, 0.0) == 0.0
    assert terminal_speed(-1.0, 0.0, 0.0) == -inf


def settled_speed(vehicle: Vehicle, axis: int, wrench: Callable[[], Sequence[float]]) -> float:
    """Return the speed after 6 s under this wrench; the vehicle must not have left the axis."""
    dynamics, state = Dynamics(vehicle, 1000.0, 9.80665), State((0.0, 0.0, 1e4))
    for _ in range(300):
        dynamics.step(state, wrench(), (0.0, 0.0, 0.0), 0.02)
    assert all(abs(state.nu[i]) < 1e-3 for i in range(6) if i != axis)
    return float(state.nu[axis])


def allocated_thrusts(vehicle: Vehicle, axis: int, force: float) -> list[float]:
    """Return the thrusts that the vehicle's own computer would allocate."""
    forward, reverse = zip(*((t.max_forward, t.max_reverse) for t in vehicle.thrusters), strict=True)
    wrench = [0.0] * 6
    wrench[axis] = force
    thrusts, residual = Allocator(wrench_matrix(vehicle), forward, reverse).allocate(wrench)
    assert residual == pytest.approx([0.0] * 6, abs=1e-6)
    return thrusts


@pytest.mark.parametrize("direction", [0, 1])
@pytest.mark.parametrize("axis", [0, 1, 2, 5])
@pytest.mark.parametrize("name", ["paper_six", "paper_seven", "bluerov2_heavy"])
def test_a_run_settles_at_the_terminal_speed(name: str, axis: int, direction: int) -> None:
    """A run in six degrees of freedom settles there under what the allocated thrusts of all thrusters make together."""
    vehicle, _ = load_vehicle(name)
    if axis != 2:  # weight would sink it meanwhile
        vehicle = vehicle._replace(neutrally_buoyant=True)
    reach = top_speeds(vehicle)[axis]
    thrusts = allocated_thrusts(vehicle, axis, reach.force[direction])
    wrench = [sum(a * f for a, f in zip(row, thrusts, strict=True)) for row in wrench_matrix(vehicle)]
    assert settled_speed(vehicle, axis, lambda: wrench) == pytest.approx(reach.speed[direction], rel=0.001)


def test_a_force_above_the_stated_limit_leaves_a_residual() -> None:
    """The stated force is the limit: a hundredth more leaves a residual, along that axis."""
    for name in preset_names("sim/vehicles"):
        vehicle, _ = load_vehicle(name)
        forward, reverse = zip(*((t.max_forward, t.max_reverse) for t in vehicle.thrusters), strict=True)
        allocator = Allocator(wrench_matrix(vehicle), forward, reverse)
        for axis, reach in enumerate(top_speeds(vehicle)):
            for force in reach.force if reach.driven else ():
                wrench = [0.0] * 6
                wrench[axis] = 1.01 * force
                _, residual = allocator.allocate(wrench)
                assert residual[axis] == pytest.approx(0.01 * force, rel=0.02), (name, axis)


def test_undriven_axes_are_reported() -> None:
    idle = {
        name: [r.axis for r in top_speeds(load_vehicle(name)[0]) if not r.driven]
        for name in preset_names("sim/vehicles")
    }
    assert {name: axes for name, axes in idle.items() if axes} == {
        "bluerov2": ["pitch"], "bluerov2_blue": ["pitch"], "bluerov2_li2020": ["pitch"], "paper_six": ["pitch"],
        **{name: list(AXES[1:]) for name in ("eca_a9", "lauv", "remus100", "tethys")},  # which have fins
        **{name: ["sway", "heave", "roll", "pitch"] for name in ("heron", "otter")},
    }  # fmt: skip


def test_torpedoes_reach_the_speeds_of_their_sources() -> None:
    """REMUS at 1525 rpm does what its source says, 2.540 m/s; the others what their sources' drag allows."""
    speeds = {name: top_speeds(load_vehicle(name)[0], 1026.0)[0].speed[0] for name in ("remus100", "eca_a9", "lauv")}
    assert speeds == pytest.approx({"remus100": 2.540, "eca_a9": (53.0 / 8.0) ** 0.5, "lauv": 2.0495}, abs=5e-4)


def test_a_single_thruster_off_the_middle_drives_no_axis_alone() -> None:
    thruster = HEAVY.thrusters[0]._replace(position=(0.0, 0.3, 0.0), direction=(1.0, 0.0, 0.0))
    speeds = top_speeds(HEAVY._replace(thrusters=(thruster,)))
    assert [reach.axis for reach in speeds if reach.driven] == []
    assert all(reach.speed == (0.0, 0.0) for reach in speeds)
    assert tuple(reach.axis for reach in speeds) == AXES


def test_each_side_of_a_hull_has_its_own_cross_flow_drag() -> None:
    flow = CrossFlow((1.2, 0.8), (0.1, 0.5))
    vehicle = HEAVY._replace(cross_flow=flow, dimensions=(2.0, 0.3, 0.4))
    sides = vehicle, vehicle._replace(cross_flow=flow._replace(length=3.0, width=0.6, height=0.5))
    drags = [[equipment_drag(each, 1000.0, axis) for axis in range(4)] for each in sides]
    assert drags[0] == pytest.approx([0.0, 400.0 * 2.0 * 0.4, 400.0 * 2.0 * 0.3, 0.0])
    assert drags[1] == pytest.approx([0.0, 400.0 * 3.0 * 0.5, 400.0 * 3.0 * 0.6, 0.0])


def test_weight_raises_the_speed_down_and_lowers_it_up() -> None:
    vehicle = HEAVY._replace(volume=0.0134 - 0.001)  # 1 kg heavier than the water it displaces, and 0.1 kg
    heave = top_speeds(vehicle)[2]
    down, up = heave.force[0] + 1.1 * 9.80665, heave.force[1] + 1.1 * 9.80665
    assert heave.speed == pytest.approx((terminal_speed(down, 33.0, 190.0), terminal_speed(up, 33.0, 190.0)))
