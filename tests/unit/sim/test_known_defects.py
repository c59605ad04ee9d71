"""Known defects of simulators and papers: their formula fails here, ours does not.

Other defects of this kind are tested where they belong: drift noise that depends on the rate (test_sensor_error),
currents and tides (test_currents), thruster lags without a clock (test_thruster_lags), buoyancy that jumps
(test_buoyancy), explicit added mass (test_dynamics), allocation matrices (test_presets), allocation without
limits (test_allocation_four).
"""

from collections.abc import Sequence
from math import cos, pi, radians, sin, sqrt
from statistics import fmean
from typing import Any

import pytest

from sim.dynamics import Dynamics, Integrator, State
from sim.environment.world import World
from sim.matrices import Matrix, product, square
from sim.rotations import from_euler
from sim.sensors.error import ErrorModel
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.dvl import Dvl, DvlModel
from sim.simulation import Simulation
from sim.vehicle.vehicle import Vehicle, load_vehicle, rigid_mass_matrix

HEAVY, _ = load_vehicle("bluerov2_heavy_vonbenzon2022")
DEEP = 1000.0
STILL, NOTHING = (0.0, 0.0, 0.0), (0.0,) * 6


def column(values: Sequence[float]) -> Matrix:
    return [[x] for x in values]


def times(matrix: Matrix, values: Sequence[float]) -> list[float]:
    return [row[0] for row in product(matrix, column(values))]


def coriolis(vehicle: Vehicle, nu: Sequence[float]) -> list[float]:
    return [-x for x in Dynamics(vehicle, 1000.0, 9.8).forces(State((0.0, 0.0, DEEP), nu=nu), NOTHING, STILL).coriolis]


def test_coriolis_is_skew_symmetric() -> None:
    """gz-sim before April 2026 had a sign and an index wrong in C, and took abs() of whole numbers: below 1 m/s
    quadratic drag vanished. Coriolis forces do no work, and drag does at any speed."""
    nu = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    wrong_matrix: Matrix = [
        [0, 0, 0, 0, 9, 4],  # (0, 5) with the other sign
        [0, 0, 0, -9, 0, 1],
        [0, 0, 0, 4, -1, 0],
        [0, 9, -4, 0, 36, -25],
        [-9, 0, 1, -36, 0, 16],
        [4, -1, 0, 25, -16, 0],
    ]
    assert abs(sum(a * b for a, b in zip(times(wrong_matrix, nu), nu, strict=True))) > 40.0
    force = coriolis(HEAVY, nu)
    assert sum(a * b for a, b in zip(force, nu, strict=True)) == pytest.approx(0.0, abs=1e-9)
    assert [int(abs(x)) * x for x in (0.5, -0.9)] == [0.0, 0.0]  # the drag of others at half a knot
    slow = Dynamics(HEAVY, 1000.0, 9.8).forces(State((0.0, 0.0, DEEP), nu=[0.5] + [0.0] * 5), NOTHING, STILL)
    assert slow.quadratic_damping[0] == pytest.approx(-141.0 * 0.25)


def test_dvl_altitude_is_not_the_mean_slant_range() -> None:
    """The altitude of uuv_simulator is the mean slant range: 10 % too much when level, at 25 degrees."""
    world = World("sea", "test", (-9.0, 9.0, -9.0, 9.0), 25.0)
    scene = Simulation(HEAVY, world, {}, position=(0.0, 0.0, 5.0))
    model = DvlModel(velocity=ErrorModel(), range=ErrorModel())
    dvl = Dvl(model, Mounting(), 1, scene)
    tilted = State((0.0, 0.0, 5.0), from_euler(radians(8.0), radians(-6.0), 0.4), (0.7, -0.2, 0.1, 0.0, 0.0, 0.0))
    ranges = [distance for distance in dvl._ranges(tilted) if distance is not None]
    assert fmean(ranges) > 1.09 * 20.0
    sample = dvl.sample(0, tilted)
    assert sample.altitude == pytest.approx(20.0)
    assert sample.velocity == pytest.approx((0.7, -0.2, 0.1))
    noisy = Dvl(DvlModel(), Mounting(), 1, scene)
    assert noisy.sample(0, tilted).velocity != pytest.approx(
        (0.7, -0.2, 0.1), abs=1e-6
    )  # noise is on unless turned off
    lost = State((0.0, 0.0, 5.0), from_euler(radians(90.0), 0.0, 0.0))
    assert not dvl.sample(0, lost).locked


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


@pytest.mark.parametrize("integrator", ["verlet", "rk4"])
def test_the_dynamics_are_independent_of_units(integrator: Integrator) -> None:
    """ArduPilot's SIM_Submarine multiplies an angular rate squared by an area and a length and calls it a torque,
    and has 10.5 kg in one place and 16.75 kg in another. Whoever computes in feet gets another spin from it;
    ours is the same ride in any units."""

    def their_speed(length: float, mass: float, time: float) -> float:
        area, radius, density = 0.06 * length**2, 0.14 * length, 1000.0 * mass / length**3
        torque = 3.0 * mass * length**2 / time**2
        return sqrt(torque / (0.5 * 1.1 * density * area * radius)) * time  # in rad per second again

    assert their_speed(METRE, KILOGRAM, SECOND) != pytest.approx(their_speed(1.0, 1.0, 1.0), rel=0.1)

    vehicle = HEAVY._replace(center_of_gravity=(0.01, -0.02, 0.03))
    force, moment = KILOGRAM * METRE / SECOND**2, KILOGRAM * METRE**2 / SECOND**2
    speed, rate = METRE / SECOND, 1.0 / SECOND
    wrench, current = [40.0, -20.0, 30.0, 2.0, -1.0, 3.0], [0.2, -0.1, 0.05]
    si = Dynamics(vehicle, 1025.0, 9.81, integrator)
    other = Dynamics(in_other_units(vehicle), 1025.0 * KILOGRAM / METRE**3, 9.81 * METRE / SECOND**2, integrator)
    ride, same = (State((0.0, 0.0, depth), from_euler(0.3, -0.2, 1.0)) for depth in (0.1, 0.1 * METRE))
    scaled_wrench = [x * force for x in wrench[:3]] + [x * moment for x in wrench[3:]]
    for _ in range(400):
        si.step(ride, wrench, current, 0.0025)
        other.step(same, scaled_wrench, [x * speed for x in current], 0.0025 * SECOND)
    assert [x / METRE for x in same.position] == pytest.approx(ride.position, rel=1e-9)
    assert [x / speed for x in same.nu[:3]] == pytest.approx(ride.nu[:3], rel=1e-9)
    assert [x / rate for x in same.nu[3:]] == pytest.approx(ride.nu[3:], rel=1e-9)
    assert same.quaternion == pytest.approx(ride.quaternion, rel=1e-9)


def test_the_coriolis_matrix_of_von_benzon_has_errors_in_print() -> None:
    """Eq. 8 prints element (4, 5) of C_RB with the wrong sign, and the authors' Ca.m leaves out the Munk moment."""
    nu = [0.0, 0.0, 0.0, 0.3, -0.4, 0.5]
    ix, iy, iz = HEAVY.inertia
    p, q, r = nu[3:]

    def turning(sign: float) -> list[float]:
        return times([[0.0, sign * iz * r, -iy * q], [-iz * r, 0.0, ix * p], [iy * q, -ix * p, 0.0]], nu[3:])

    assert abs(sum(a * b for a, b in zip(turning(-1.0), nu[3:], strict=True))) > 0.04  # as printed: it makes power
    assert sum(a * b for a, b in zip(turning(1.0), nu[3:], strict=True)) == pytest.approx(0.0, abs=1e-15)
    rigid = HEAVY._replace(added_mass=(1e-12,) * 6)
    assert coriolis(rigid, nu)[3:] == pytest.approx(turning(1.0), abs=1e-9)
    assert rigid_mass_matrix(HEAVY)[3][3] == ix

    sideways = [0.8, 0.3, 0.0, 0.0, 0.0, 0.0]
    added = square(HEAVY.added_mass, 6)
    distributed = [0.0, 0.0, 0.0]  # skew(M_A omega) v: nothing where nothing turns
    munk = (added[1][1] - added[0][0]) * 0.8 * 0.3
    assert coriolis(HEAVY, sideways)[5] == pytest.approx(munk)
    assert distributed[2] != pytest.approx(munk, abs=0.1)


def test_the_third_thruster_of_von_benzon_has_a_misprint() -> None:
    """Table A1 turns thruster 3 by 3 pi/4, a misprint of 3 pi/2: it would push sideways alone."""

    def rates_at(angle: float) -> tuple[float, float]:
        x, y = 1.0 / sqrt(2.0), -1.0 / sqrt(2.0)
        return cos(angle) * x - sin(angle) * y, sin(angle) * x + cos(angle) * y

    directions = {thruster.name: thruster.unit_direction[:2] for thruster in HEAVY.thrusters}
    assert rates_at(0.75 * pi) == pytest.approx((0.0, 1.0))
    assert rates_at(1.5 * pi) == pytest.approx(directions["rear_right"])
    for name, angle in (("front_right", 0.0), ("front_left", 0.5 * pi), ("rear_left", pi)):
        assert rates_at(angle) == pytest.approx(directions[name])


def test_forces_are_finite_astern() -> None:
    """The speed of MSS's remus100.m is sqrt(u^1 + v^2), which going astern is no real number. Ours is the magnitude of
    the velocity: all forces are finite, and turn about with it.
    """
    their_speed = complex(-1.5 + 0.2**2) ** 0.5
    assert abs(their_speed.imag) > 1.0
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
