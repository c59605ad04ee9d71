"""Energy: by the battery, by a thruster whose current is known, and by a T200 of the same thrust."""

import pytest

from hil.cases.energy import EnergyMeter, power, power_of_thrust
from sim.sensors.extra_samples import BatterySample
from sim.vehicle.thrusters.bank import steady_thrust
from sim.vehicle.thrusters.curves import T200
from sim.vehicle.thrusters.t200 import performance
from sim.vehicle.vehicle import load_vehicle

SIX, _ = load_vehicle("paper_six")


def test_t200_power_equals_its_performance_table() -> None:
    for pulse in (1560, 1650, 1800, 1900, 1440, 1200):
        found = performance(pulse, 16.0)
        assert power_of_thrust(found.thrust) == pytest.approx(found.power, rel=0.02)
        assert power([SIX.thrusters[0]._replace(curve=T200(16.0))], [pulse]) == pytest.approx(found.power)


def test_power_beyond_the_table_follows_an_ideal_propeller() -> None:
    most = performance(1900, 16.0)
    assert power_of_thrust(2.0 * most.thrust) == pytest.approx(most.power * 2.0**1.5, rel=1e-6)
    sizes = [power_of_thrust(0.5 * n) for n in range(200)]
    assert sizes[0] == 0.0
    assert sizes == sorted(sizes)
    assert power_of_thrust(-20.0) > power_of_thrust(20.0)  # in reverse it costs more


def test_energy_is_summed_over_pulses_and_time() -> None:
    meter = EnergyMeter(SIX)
    pulses = (1600, 1600, 1600, 1600, 1500, 1500)
    watts = 4.0 * power_of_thrust(steady_thrust(SIX.thrusters[0], 1600))
    for number in range(101):
        meter.add(0.1 * number, pulses)
    assert meter.joules == pytest.approx(10.0 * watts)
    meter.add(1000.0, pulses)  # a gap in the report counts for two seconds
    assert meter.joules == pytest.approx(12.0 * watts)
    meter.add(1000.5, ())  # no pulses were received
    assert meter.joules == pytest.approx(12.0 * watts)


def test_a_battery_sample_takes_precedence_over_pulses() -> None:
    meter = EnergyMeter(SIX)
    for number in range(11):
        meter.add(0.1 * number, (1900,) * 6, BatterySample(0, 15.0, 4.0, 9.0, 10.0, False))
    assert meter.joules == pytest.approx(60.0)
