"""Known defects of simulators and papers: ours does not have them.

Other defects of this kind are tested where they belong: drift noise that depends on the rate (test_sensor_error),
currents and tides (test_currents), thruster lags without a clock (test_thrusters), buoyancy that jumps
(test_buoyancy), Coriolis forces that do work (test_dynamics), an altitude that is the mean slant range (test_sensors),
allocation matrices (test_presets), allocation without limits (test_allocation_four).
"""

from collections.abc import Sequence
from typing import Any

import pytest

from sim.dynamics import Dynamics, State
from sim.environment.world import World
from sim.rotations import from_euler
from sim.simulation import Simulation
from sim.vehicle.vehicle import Vehicle, load_vehicle

HEAVY, _ = load_vehicle("bluerov2_heavy_vonbenzon2022")
DEEP = 1000.0
STILL, NOTHING = (0.0, 0.0, 0.0), (0.0,) * 6
METRE, KILOGRAM, SECOND = 3.7, 0.21, 1.9  # of a metre, kilogram and second, in units of some other system


def in_other_units(vehicle: Vehicle) -> Vehicle:
    """Return the same vehicle with every number in those units."""
    area = METRE * METRE
    translation, turning = [KILOGRAM] * 3, [KILOGRAM * area] * 3
    per_time = [x / SECOND for x in translation + turning]
    per_speed = [KILOGRAM / METRE] * 3 + turning

    def scaled(values: Sequence[float], factors: Sequence[float]) -> tuple[float, ...]:
        return tuple(x * factor for x, factor in zip(values, factors, strict=True))

    lengths: dict[str, Any] = {
        name: tuple(x * METRE for x in getattr(vehicle, name))
        for name in ("dimensions", "center_of_gravity", "center_of_buoyancy")
    }
    return vehicle._replace(
        mass=vehicle.mass * KILOGRAM, volume=vehicle.volume * METRE**3, inertia=scaled(vehicle.inertia, turning),
        added_mass=scaled(vehicle.added_mass, translation + turning),
        linear_damping=scaled(vehicle.linear_damping, per_time),
        quadratic_damping=scaled(vehicle.quadratic_damping, per_speed), **lengths,
    )  # fmt: skip


def test_the_dynamics_are_independent_of_units() -> None:
    """ArduPilot's SIM_Submarine multiplies an angular rate squared by an area and a length and calls it a torque,
    and has 10.5 kg in one place and 16.75 kg in another. Whoever computes in feet gets another spin from it;
    ours is the same ride in any units."""

    vehicle = HEAVY._replace(center_of_gravity=(0.01, -0.02, 0.03))
    force, moment = KILOGRAM * METRE / SECOND**2, KILOGRAM * METRE**2 / SECOND**2
    speed, rate = METRE / SECOND, 1.0 / SECOND
    wrench, current = [40.0, -20.0, 30.0, 2.0, -1.0, 3.0], [0.2, -0.1, 0.05]
    si = Dynamics(vehicle, 1025.0, 9.81)
    other = Dynamics(in_other_units(vehicle), 1025.0 * KILOGRAM / METRE**3, 9.81 * METRE / SECOND**2)
    ride, same = (State((0.0, 0.0, depth), from_euler(0.3, -0.2, 1.0)) for depth in (0.1, 0.1 * METRE))
    scaled_wrench = [x * force for x in wrench[:3]] + [x * moment for x in wrench[3:]]
    for _ in range(400):
        si.step(ride, wrench, current, 0.0025)
        other.step(same, scaled_wrench, [x * speed for x in current], 0.0025 * SECOND)
    assert [x / METRE for x in same.position] == pytest.approx(ride.position, rel=1e-9)
    assert [x / speed for x in same.nu[:3]] == pytest.approx(ride.nu[:3], rel=1e-9)
    assert [x / rate for x in same.nu[3:]] == pytest.approx(ride.nu[3:], rel=1e-9)
    assert same.quaternion == pytest.approx(ride.quaternion, rel=1e-9)


def test_forces_are_finite_astern() -> None:
    """The speed of MSS's remus100.m is sqrt(u^1 + v^2), which going astern is no real number. Ours is the magnitude of
    the velocity: all forces are finite, and turn about with it.
    """
    vehicle, _ = load_vehicle("remus100")
    world = World("sea", "test", (-500.0, 500.0, -500.0, 500.0), 100.0)
    simulation = Simulation(vehicle, world, {}, position=(0.0, 0.0, 50.0))
    slowest = 0.0
    for _ in range(4000):
        simulation.step((1100, 1700, 1500))  # full astern, rudder over
        slowest = min(slowest, simulation.state.nu[0])
    assert slowest < -1.0
    assert all(abs(x) < 10.0 for x in (*simulation.state.nu, *simulation.state.nu_dot))
    others = simulation.forces().others
    assert others[0] > 1.0  # the hull's drag is ahead
    assert abs(simulation.state.nu[5]) > 0.01  # and the rudder acts
