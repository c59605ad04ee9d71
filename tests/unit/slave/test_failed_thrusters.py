"""Thrusters that fail: noticed by their telemetry, left out, and used again after a repair."""

import os
from math import degrees, hypot, nan, radians
from statistics import fmean
from typing import Any

import numpy as np
import pytest

from hil.autonomy.control.controller import VelocityCommand, heading_of
from hil.autonomy.control.thruster_monitor import ThrusterMonitor
from hil.common.schema import preset_folder
from hil.scenario.config import Scenario
from hil.scenario.records import Master
from hil.slave.pilot import build_pilot
from hil.tuning.rig import DEEP
from sim.rotations import to_euler
from sim.sensors.sensor_set import select_sensors
from sim.simulation import Simulation
from sim.vehicle.failures import Failure, Kind
from sim.vehicle.thrusters.bank import wrench_matrix
from sim.vehicle.vehicle import Vehicle, load_vehicle

DT_NS, PERIOD_S, DEPTH = 10_000_000, 0.02, 20.0
PRESETS = sorted(name[:-5] for name in os.listdir(preset_folder("sim/vehicles")) if name.endswith(".toml"))
# The thrusters to port are mirror images of those to starboard.
CASES = [(name, one.name) for name in PRESETS for one in load_vehicle(name)[0].thrusters if one.position[1] >= 0.0]
MOST_DEG, MOST_M = 3.0, 0.15  # of heading and depth


class Flight:
    """A vehicle with its controller that holds depth and heading, with fins at a speed of 0.8 m/s."""

    def __init__(self, name: str, vehicle: Vehicle | None = None) -> None:
        loaded, control = load_vehicle(name)
        self.vehicle = vehicle or loaded
        scenario = Scenario(vehicle=name, world=DEEP.name, master=Master(goal=(0.0, 0.0)), sensors=select_sensors())
        lift = Simulation(self.vehicle, DEEP, {}, position=(0.0, 0.0, DEPTH)).forces().restoring[2]
        self.floats = -lift > 0.5 * self.vehicle.mass
        depth = 0.0 if self.floats else DEPTH
        self.simulation = Simulation(self.vehicle, DEEP, scenario.sensors, 1, DT_NS, (0.0, 0.0, depth))
        self.pilot = build_pilot(scenario, self.vehicle, control, DEEP)
        self.pilot.watch_thrusters(self.simulation.thruster_reports)
        self.reports: list[str] = []
        self.pilot.report = self.reports.append
        self.lift = 0.0 if self.floats else lift
        self.command = VelocityCommand(
            surge=0.8 if self.vehicle.fins else 0.0, depth=None if self.floats else DEPTH, heading=0.0
        )

    def fly(self, seconds: float) -> float:
        """Return how far (m) its depth was astray at most."""
        astray = 0.0
        for _ in range(round(seconds / PERIOD_S)):
            self.pilot.set_command(self.command, self.simulation.time_ns)
            pulses = self.pilot.update(self.simulation.time_ns, PERIOD_S)[0].pwm_us
            for _ in range(2):
                for topic, sample in self.simulation.step(pulses):
                    self.pilot.update_sensor(topic, sample)
            astray = max(astray, abs(self.simulation.state.position[2] - DEPTH))
        return 0.0 if self.floats else astray

    def fail(self, name: str, kind: Kind, **keys: Any) -> None:
        self.simulation.fail(Failure(name, kind, self.simulation.time_ns * 1e-9, **keys))

    def can_hold(self, gone: str) -> bool:
        """Return whether the other thrusters can balance the lift without turning the vehicle over or round.

        A vehicle with fins steers only while it moves.
        """
        matrix = np.array(wrench_matrix(self.vehicle, torque=False))
        left = matrix[:, [thruster.name != gone for thruster in self.vehicle.thrusters]]
        if self.vehicle.fins:
            return bool(left[0].any())
        limits = [min(t.max_forward, t.max_reverse) for t in self.vehicle.thrusters if t.name != gone]
        wanted = np.array([-self.lift, 0.0])  # of heave and yaw
        thrusts = np.linalg.pinv(left[[2, 5]]) @ wanted
        turning = hypot(*(left[[3, 4]] @ thrusts))
        above = self.vehicle.center_of_gravity[2] - self.vehicle.center_of_buoyancy[2]
        righting = self.vehicle.mass * DEEP.gravity * above * radians(20.0)
        balanced = np.allclose(left[[2, 5]] @ thrusts, wanted, atol=1e-6) and left[5].any()
        return bool(balanced and (abs(thrusts) <= limits).all() and (self.floats or turning < righting))


@pytest.mark.parametrize(("name", "thruster"), CASES)
def test_a_vehicle_holds_depth_and_heading_without_one_thruster(name: str, thruster: str) -> None:
    """What can hold them is computed; the others are vehicles with fins whose only propeller is dead."""
    flight = Flight(name)
    flight.fly(4.0)
    flight.fail(thruster, "off")
    astray = flight.fly(12.0)
    if not flight.can_hold(thruster):
        assert flight.vehicle.fins
        assert flight.pilot.failed_thrusters == [thruster]
        return
    assert astray < MOST_M
    assert abs(to_euler(flight.simulation.state.quaternion)[2]) < radians(MOST_DEG)
    assert flight.pilot.failed_thrusters in ([thruster], [])  # it may be one that need not turn
    flight.fail(thruster, "repaired")
    assert flight.fly(7.0) < MOST_M
    assert flight.pilot.failed_thrusters == []
    assert flight.reports[-1:] in ([], [f"thruster {thruster} follows its commands again"])
    assert flight.floats or hypot(*to_euler(flight.simulation.state.quaternion)[:2]) < 0.05


@pytest.mark.parametrize(
    ("kind", "keys"), [("off", {}), ("stuck", {"pwm_us": 1580}), ("efficiency", {"efficiency": 0.05})]
)
def test_a_dead_stuck_or_bladeless_vertical_thruster_is_named(kind: Kind, keys: dict[str, Any]) -> None:
    flight = Flight("bluerov2")
    flight.fly(6.0)
    flight.fail("vertical_left", kind, **keys)
    assert flight.fly(30.0) < 0.15
    assert flight.pilot.failed_thrusters == ["vertical_left"]
    assert flight.reports == [
        "thruster vertical_left does not do what it is commanded: the others take over what they can"
    ]


def test_without_telemetry_the_vehicle_is_lost_and_the_figure_says_that_nobody_watches() -> None:
    vehicle, _ = load_vehicle("bluerov2")
    blind = vehicle._replace(thrusters=tuple([each._replace(telemetry=False) for each in vehicle.thrusters]))
    flight = Flight("bluerov2", blind)
    flight.fly(6.0)
    flight.fail("vertical_left", "off")
    assert flight.fly(18.0) > 0.5
    assert flight.pilot.failed_thrusters == []
    assert flight.pilot.unwatched_thrusters == [thruster.name for thruster in vehicle.thrusters]


def test_a_thruster_that_lags_or_is_weak_by_a_low_battery_has_not_failed() -> None:
    monitor = ThrusterMonitor([50.0, 50.0], [1.0, 0.0])
    lagged = 0.0
    for step in range(2000):
        wanted = 20.0 if step // 100 % 2 else -20.0
        lagged += 0.02 * (wanted - lagged)
        assert not monitor.update([wanted, wanted], [lagged, 0.4 * wanted], 0.02)
    assert monitor.unwatched == [False, False]
    monitor.update([0.0, 0.0], [nan, 0.0], 0.02)
    assert monitor.unwatched == [True, False]


# -- the bias of the gyros --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["bluerov2", "paper_six", "lauv"])
def test_a_heading_has_no_standing_error_from_a_gyros_bias(name: str) -> None:
    """The default IMU has a bias of half a degree a second. A turn beyond the yaw rate's limit winds nothing up."""
    flight = Flight(name)
    flight.fly(10.0)
    overshoots, errors = [], []
    for heading in (1.5, -1.5, 0.0):
        flight.command = flight.command._replace(heading=heading)
        way = heading - heading_of(flight.pilot.navigation.orientation)
        most = 0.0
        for _ in range(1500):
            flight.fly(PERIOD_S)
            most = max(most, (heading_of(flight.pilot.navigation.orientation) - heading) / way)
        found = []
        for _ in range(500):
            flight.fly(PERIOD_S)
            found.append(heading_of(flight.pilot.navigation.orientation))
        overshoots.append(most)
        errors.append(degrees(fmean(found)) - degrees(heading))
    assert max(map(abs, errors)) < 0.05
    assert max(overshoots) < 0.05
