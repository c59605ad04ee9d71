"""The cascade in the real simulator: with its own vehicle, in a current, and with a wrong mass."""

from statistics import fmean
from typing import Any

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.common.schema import preset_names
from hil.tuning.rig import START_DEPTH, Moment, Rig
from sim.vehicle.vehicle import Vehicle, load_vehicle

VEHICLES = ("bluerov2_heavy", "paper_six")
STILL = VelocityCommand(depth=START_DEPTH, heading=0.0)
GYRO = 0.03  # rad: the heading error due to a gyro's turn-on error, with any control law
CURRENT = (0.2, 0.2, 0.0)


def heavier(vehicle: Vehicle, share: float) -> Vehicle:
    """Return the vehicle with that much more mass, trimmed to weigh the same, as with a full sample box."""
    added = vehicle.mass * share
    return vehicle._replace(mass=vehicle.mass + added, volume=vehicle.volume + added / 1025.0)


def make_rig(name: str, **changes: Any) -> Rig:
    vehicle, control = load_vehicle(name)
    return Rig(name, vehicle, control, **changes)


def last_third(moments: list[Moment]) -> list[Moment]:
    return moments[-len(moments) // 3 :]


def surge_error(moments: list[Moment], setpoint: float) -> float:
    """Return the mean error of surge over the last third."""
    return fmean(moment.nu[0] for moment in last_third(moments)) - setpoint


@pytest.mark.parametrize("name", VEHICLES)
def test_steps_of_speed_depth_and_heading_are_reached(name: str) -> None:
    vehicle = make_rig(name)
    vehicle.fly(4.0, lambda time: STILL)
    surge_only = vehicle.fly(8.0, lambda time: STILL._replace(surge=0.3))
    assert abs(surge_error(surge_only, 0.3)) < 0.01
    assert max(moment.nu[0] for moment in surge_only) < 1.15 * 0.3
    assert min(moment.time for moment in surge_only if moment.nu[0] > 0.27) < 1.5
    all_axes = vehicle.fly(15.0, lambda time: STILL._replace(surge=0.3, depth=START_DEPTH + 1.0, heading=1.0))
    assert max(moment.position[2] for moment in all_axes) < START_DEPTH + 1.05
    assert last_third(all_axes)[-1].position[2] == pytest.approx(START_DEPTH + 1.0, abs=0.03)
    assert max(moment.attitude[2] for moment in all_axes) < 1.06
    assert last_third(all_axes)[-1].attitude[2] == pytest.approx(1.0, abs=GYRO)
    assert max(abs(angle) for moment in last_third(all_axes) for angle in moment.attitude[:2]) < 0.05


@pytest.mark.parametrize("name", VEHICLES)
def test_an_unmeasured_current_is_rejected(name: str) -> None:
    vehicle = make_rig(name, current=CURRENT)
    vehicle.fly(6.0, lambda time: STILL)
    moments = vehicle.fly(10.0, lambda time: STILL._replace(surge=0.3))
    assert abs(surge_error(moments, 0.3)) < 0.01
    assert max(moment.nu[0] for moment in moments[50:]) < 0.3 * 1.2 + 0.01
    assert last_third(moments)[-1].position[2] == pytest.approx(START_DEPTH, abs=0.03)
    assert last_third(moments)[-1].attitude[2] == pytest.approx(0.0, abs=GYRO)


@pytest.mark.parametrize("share", [-0.2, 0.3])
@pytest.mark.parametrize("name", VEHICLES)
def test_a_wrong_mass_leaves_small_errors(name: str, share: float) -> None:
    vehicle, _ = load_vehicle(name)
    flown = heavier(vehicle._replace(neutrally_buoyant=False, volume=vehicle.mass / 1025.0), share)
    flight = make_rig(name, flown=flown)
    flight.fly(4.0, lambda time: STILL)
    moments = flight.fly(8.0, lambda time: STILL._replace(surge=0.3))
    assert abs(surge_error(moments, 0.3)) < 0.01
    assert max(moment.nu[0] for moment in moments) < 1.2 * 0.3
    assert last_third(moments)[-1].position[2] == pytest.approx(START_DEPTH, abs=0.03)


@pytest.mark.parametrize("name", VEHICLES)
def test_a_saturated_vehicle_recovers_within_seconds(name: str) -> None:
    """It is at a slow speed within seconds after 10 s beyond its thrusters, not only when an integral has run down.
    Depth is held meanwhile.
    """
    vehicle = make_rig(name)
    vehicle.fly(3.0, lambda time: STILL)
    beyond = vehicle.fly(10.0, lambda time: STILL._replace(sway=4.0))
    assert max(moment.nu[1] for moment in beyond) < 2.0
    assert all(abs(moment.position[2] - START_DEPTH) < 0.6 for moment in beyond)
    recovery = vehicle.fly(6.0, lambda time: STILL._replace(sway=0.1))
    assert all(abs(moment.nu[1] - 0.1) < 0.04 for moment in recovery if moment.time > 3.0)
    jump = beyond[-1].nu[1] - 0.1
    assert min(moment.nu[1] for moment in recovery) > 0.1 - 0.35 * jump


PRESETS = {name: load_vehicle(name)[0] for name in preset_names("sim/vehicles")}
THRUSTER_DRIVEN = [name for name, each in PRESETS.items() if not each.fins and not each.hull]  # a hull floats


@pytest.mark.parametrize("name", THRUSTER_DRIVEN)
def test_every_preset_holds_and_follows_depth_heading_and_speed(name: str) -> None:
    """The vehicle reaches 0.3 m/s ahead, 2 m deeper and a turn of 1 rad at once by its file's gains, and holds them."""
    vehicle = make_rig(name)
    hold = vehicle.fly(4.0, lambda time: STILL)
    assert last_third(hold)[-1].position[2] == pytest.approx(START_DEPTH, abs=0.05)
    moments = vehicle.fly(16.0, lambda time: STILL._replace(surge=0.3, depth=START_DEPTH + 2.0, heading=1.0))
    assert abs(surge_error(moments, 0.3)) < 0.01
    assert all(abs(moment.nu[0] - 0.3) < 0.03 for moment in last_third(moments))
    assert all(abs(moment.position[2] - START_DEPTH - 2.0) < 0.03 for moment in last_third(moments))
    assert all(abs(moment.attitude[2] - 1.0) < GYRO for moment in last_third(moments))
    assert max(moment.position[2] for moment in moments) < START_DEPTH + 2.15
    assert max(moment.attitude[2] for moment in moments) < 1.1
    assert max(abs(angle) for moment in last_third(moments) for angle in moment.attitude[:2]) < 0.03
