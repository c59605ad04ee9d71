"""Sensors with a position and orientation of their own: their samples belong to these."""

from math import radians

import pytest

from sim.dynamics import State
from sim.rotations import from_euler, multiply, rotate
from sim.sensors.imu import Imu, specific_force
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.dvl import Dvl
from tests.support.fitted import ASKEW, NU
from tests.unit.sim.sensors.test_sensors import EXACT_DVL, EXACT_IMU, SCENE


def test_a_mounting_has_its_own_position_and_attitude() -> None:
    nose_up = State((10.0, 20.0, 5.0), from_euler(0.0, radians(90), 0.0))
    mounting = Mounting((2.0, 0.0, 0.0), (0.0, radians(-90), 0.0))
    assert mounting.world_position(nose_up) == pytest.approx((10.0, 20.0, 3.0))
    assert mounting.depth(nose_up) == pytest.approx(3.0)
    assert mounting.attitude(nose_up) == pytest.approx((1.0, 0.0, 0.0, 0.0))


def test_a_rotated_imu_measures_the_same_in_other_axes() -> None:
    state = State((1.0, 2.0, 3.0), from_euler(0.15, -0.2, 2.0), NU)
    state.nu_dot = [0.1, 0.2, -0.3, 0.4, -0.5, 0.6]
    straight = Imu(EXACT_IMU, Mounting(ASKEW.position), 1, SCENE).sample(0, state)
    askew = Imu(EXACT_IMU, ASKEW, 1, SCENE).sample(0, state)
    assert straight.acceleration == pytest.approx(specific_force(state, ASKEW.position, 9.8))
    rotation = from_euler(*ASKEW.orientation)
    assert rotate(rotation, askew.acceleration) == pytest.approx(straight.acceleration)
    assert rotate(rotation, askew.angular_velocity) == pytest.approx(NU[3:])
    assert askew.orientation == pytest.approx(multiply(state.quaternion, rotation))


def test_a_dvl_directed_ahead_has_no_bottom_lock_until_the_vehicle_dives() -> None:
    ahead = Dvl(EXACT_DVL, Mounting(orientation=(0.0, radians(90), 0.0)), 1, SCENE)
    assert not ahead.sample(0, State((0.0, 0.0, 5.0), nu=NU)).locked
    diving = ahead.sample(0, State((0.0, 0.0, 5.0), from_euler(0.0, radians(-90), 0.0), NU))
    assert diving.locked
    assert diving.velocity == pytest.approx((-NU[2], NU[1], NU[0]))
    assert diving.altitude == pytest.approx(15.0)
