"""Azimuth thrusters: the allocation's angles and thrusts give the wrench; a vessel with them holds its place."""

from math import cos, dist, pi, sin

import pytest

from hil.autonomy.control.azimuth import AzimuthAllocator
from hil.autonomy.control.controller import VelocityCommand
from hil.doctor.vehicle.subject import Subject
from hil.tuning.rig import DEEP, Rig
from sim.environment.wind import Wind
from sim.vehicle.thrusters.azimuth import turned
from sim.vehicle.thrusters.bank import wrench_matrix
from sim.vehicle.thrusters.model import Azimuth, Thruster
from sim.vehicle.vehicle import Vehicle, load_vehicle


def turning(limit: float, rate: float = 2.0) -> Vehicle:
    """Return an otter with an azimuth thruster at each end, whose angle is at most `limit` rad."""
    otter, control = load_vehicle("otter")
    assert control
    places = (0.7, 0.0, 0.25), (-0.8, 0.0, 0.25)
    thrusters = [
        one._replace(position=place, azimuth=Azimuth(limit, rate=rate))
        for one, place in zip(otter.thrusters, places, strict=True)
    ]
    return otter._replace(thrusters=tuple(thrusters))


def allocator_of(thrusters: tuple[Thruster, ...]) -> AzimuthAllocator:
    vehicle = turning(pi)._replace(thrusters=thrusters)
    limits = [each.azimuth.max_deflection if each.azimuth else 0.0 for each in thrusters]
    matrix = wrench_matrix(vehicle, torque=False)
    sideways = wrench_matrix(vehicle._replace(thrusters=tuple(map(turned, thrusters))), torque=False)
    forward, reverse = [each.max_forward for each in thrusters], [each.max_reverse for each in thrusters]
    return AzimuthAllocator(matrix, sideways, forward, reverse, limits)


@pytest.mark.parametrize("wanted", [(40.0, 0.0, 0.0), (0.0, 30.0, 0.0), (-20.0, -10.0, 8.0), (5.0, -50.0, 20.0)])
def test_angles_and_thrusts_give_the_wrench(wanted: tuple[float, float, float]) -> None:
    thrusters = turning(pi).thrusters
    thrusts, angles, residual = allocator_of(thrusters).allocate((wanted[0], wanted[1], 0.0, 0.0, 0.0, wanted[2]))
    x = sum(f * cos(a) for f, a in zip(thrusts, angles, strict=True))
    y = sum(f * sin(a) for f, a in zip(thrusts, angles, strict=True))
    n = sum(f * sin(a) * t.position[0] for f, a, t in zip(thrusts, angles, thrusters, strict=True))
    assert (x, y, n) == pytest.approx(wanted, rel=0.001, abs=0.001)
    assert (residual[0], residual[1], residual[5]) == pytest.approx((0.0, 0.0, 0.0), abs=0.05)


def test_a_failed_thruster_is_left_out() -> None:
    allocator = allocator_of(turning(pi).thrusters)
    allocator.leave_out([True, False])
    thrusts, angles, residual = allocator.allocate((20.0, 0.0, 0.0, 0.0, 0.0, 8.0))
    assert thrusts[0] == pytest.approx(0.0, abs=1e-9)
    assert thrusts[1] * cos(angles[1]) == pytest.approx(20.0, rel=0.01)
    assert abs(residual[5]) < 8.0


def test_a_limited_thruster_pushes_astern_or_reports_what_it_cannot() -> None:
    """Within 60 degrees ahead and astern; beyond, the share of the force along the nearest angle."""
    allocator = allocator_of(turning(pi / 3.0).thrusters)
    thrusts, angles, residual = allocator.allocate((-40.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert angles == pytest.approx([0.0, 0.0])
    assert sum(thrusts) == pytest.approx(-40.0, rel=0.001)
    thrusts, angles, residual = allocator.allocate((0.0, 40.0, 0.0, 0.0, 0.0, -2.0))
    assert [abs(angle) for angle in angles] == pytest.approx([pi / 3.0] * 2)
    assert residual[1] == pytest.approx(40.0 * cos(pi / 3.0) ** 2, rel=0.05)
    _, again, _ = allocator.allocate((0.0,) * 6)
    assert again == angles, "without a force it does not turn"


def test_a_vessel_with_azimuth_thrusters_moves_sideways_against_the_wind() -> None:
    """It keeps its heading and its sway speed in a beam wind, which two fixed thrusters cannot; angles take time."""
    vehicle, control = turning(pi), load_vehicle("otter")[1]
    rig = Rig("otter", vehicle, control, world=DEEP._replace(wind=Wind(6.0, -pi / 2.0, gusts=0.1)), depth=0.0)
    equipment = rig.simulation.equipment
    assert equipment
    assert equipment.azimuths
    assert vehicle.channels == ("left", "right", "left azimuth", "right azimuth")
    assert Subject(vehicle, {}).capabilities[1].force == pytest.approx((1.875 * 119.682, -1.875 * 66.708))
    rig.fly(0.1, lambda time: VelocityCommand(sway=0.3, depth=0.0, heading=0.0))
    assert max(map(abs, equipment.azimuths.angles)) <= 0.2 + 1e-9, "2 rad/s"
    moments = rig.fly(20.0, lambda time: VelocityCommand(sway=0.3, depth=0.0, heading=0.0))
    last = moments[-250:]
    assert [sum(m.nu[1] for m in last) / len(last)] == pytest.approx([0.3], abs=0.03)
    assert max(abs(m.attitude[2]) for m in last) < 0.1
    assert dist(last[0].position[:2], last[-1].position[:2]) == pytest.approx(1.5, rel=0.1)
