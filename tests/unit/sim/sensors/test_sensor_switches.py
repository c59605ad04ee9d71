"""Battery monitor, leak detector and contact switch."""

from types import SimpleNamespace
from typing import Any

import pytest

from sim.dynamics import State
from sim.environment.world import load_world
from sim.rotations import from_euler
from sim.sensors.battery import BatteryMonitor, BatteryMonitorModel
from sim.sensors.contact import ContactModel, ContactSwitch
from sim.sensors.error import ErrorModel
from sim.sensors.extra_samples import BatterySample, FlagSample
from sim.sensors.leak import Leak, LeakModel
from sim.sensors.mounting import Mounting
from sim.sensors.sensor_set import SensorSpec
from sim.simulation import Simulation
from sim.vehicle.battery import Battery, BatteryState
from sim.vehicle.thrusters.curves import T200
from sim.vehicle.vehicle import Vehicle, load_vehicle

VEHICLE, _ = load_vehicle("paper_six")
POOL = load_world("pool")
SCENE = Simulation(VEHICLE, POOL, {}, position=(0.0, 0.0, 1.0))
S = 1_000_000_000


def with_battery() -> Vehicle:
    thrusters = tuple(thruster._replace(curve=T200(), time_constant=0.0) for thruster in VEHICLE.thrusters)
    battery = Battery(266.0, (0.0, 0.1, 1.0), (12.4, 14.0, 16.8), 0.05, cut_off=11.0, hotel_current=1.5)
    return VEHICLE._replace(thrusters=thrusters, battery=battery)


def test_a_battery_monitor_measures_the_battery() -> None:
    vehicle = with_battery()
    exact = BatteryMonitorModel(voltage=ErrorModel(), current=ErrorModel())
    simulation = Simulation(vehicle, POOL, {"battery": SensorSpec(BatteryMonitor, exact)}, position=(0.0, 0.0, 1.0))
    stream = (sample for _ in range(800) for _, sample in simulation.step((1700,) * 6))
    samples = [sample for sample in stream if isinstance(sample, BatterySample)]
    assert vehicle.battery is not None
    assert len(samples) == 2
    state = simulation.battery
    assert isinstance(state, BatteryState)
    full = vehicle.battery.capacity_ah
    assert samples[-1] == (2 * S, state.voltage, state.current, state.fraction * full, full, False)
    assert state.current > 10.0
    assert samples[0].charge - samples[1].charge == pytest.approx(state.current / 3600.0, rel=0.02)


def test_a_leak_starts_at_its_time() -> None:
    leak = Leak(LeakModel(at=3.0), Mounting(), 1, SCENE)
    wet = [leak.sample(i * S, State()).on for i in range(6)]
    assert wet == [False, False, False, True, True, True]


def test_a_leak_below_a_depth_persists() -> None:
    """The depth is the detector's: 1 m ahead of the origin of a vehicle that dives steeply."""
    leak = Leak(LeakModel(below=10.0), Mounting((1.0, 0.0, 0.0)), 1, SCENE)
    depths = [5.0, 9.6, 9.4, 9.6, 3.0]
    down = from_euler(0.0, -1.5707963, 0.0)
    level = [leak.sample(0, State((0.0, 0.0, depth))).on for depth in depths]
    assert not any(level)
    assert leak.sample(0, State((0.0, 0.0, 9.4), down)).on
    assert leak.sample(0, State((0.0, 0.0, 0.0))).on


def test_a_leak_detector_without_settings_reports_no_leak() -> None:
    leak = Leak(LeakModel(), Mounting(), 1, SCENE)
    assert not any(leak.sample(i * 10**15, State((0.0, 0.0, 9000.0))).on for i in range(10))


def test_a_contact_switch_reports_every_contact() -> None:
    """A contact with a wall at full speed is reported although it is over when the switch is read."""
    slow = SensorSpec(ContactSwitch, ContactModel(rate=1.0))
    simulation = Simulation(VEHICLE, POOL, {"contact": slow}, position=(6.0, 0.0, 2.0))
    received: list[tuple[bool, int]] = []
    for step in range(4800):
        ahead = 1900 if step < 1000 else 1100 if step < 1500 else 1500
        before = simulation.contacts
        for _, sample in simulation.step((ahead,) * 4 + (1500, 1500)):
            assert isinstance(sample, FlagSample)
            received.append((sample.on, before))
    assert simulation.contacts > 0
    on = [pressed for pressed, _ in received]
    assert on[0] is False
    assert any(on)
    first = on.index(True)
    assert received[first][1] > received[first - 1][1]
    assert not simulation.touching
    assert not on[-1]  # off again once it has backed away


def test_a_contact_switch_is_on_as_long_as_it_is_pressed() -> None:
    scene: Any = SimpleNamespace(touching=False, contacts=0)
    switch, found = ContactSwitch(ContactModel(), Mounting(), 1, scene), []
    for scene.touching, scene.contacts in ((False, 0), (True, 1), (True, 1), (False, 1), (False, 2), (False, 2)):
        found.append(switch.sample(0, State()).on)
    assert found == [False, True, True, False, True, False]
