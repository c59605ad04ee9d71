"""The battery: the circuit with its load, energy balance, voltage sag, and wrong tables."""

import math
from pathlib import Path
from typing import Any

import pytest

from hil.common.errors import ConfigError
from hil.common.schema import parse
from sim.assembly import make_thrusters
from sim.vehicle.battery import Battery, BatteryPack
from sim.vehicle.failures import Failure
from sim.vehicle.thrusters.t200 import VOLTS, performance
from sim.vehicle.vehicle import load_vehicle

PRESET = Path(__file__).parents[4] / "sim/vehicles/paper_six.toml"
TABLE: dict[str, Any] = {
    "capacity_wh": 266.0, "charge": [0.0, 0.1, 1.0], "open_circuit": [12.4, 14.0, 16.8], "resistance": 0.05,
}  # fmt: skip
TOML = """
[battery]
capacity_wh = 266.0
charge = [0.0, 0.1, 1.0]
open_circuit = [12.4, 14.0, 16.8]
resistance = 0.05
cut_off = 11.0
"""


def vehicle_file(tmp_path: Path, battery: str = TOML, curve: str = 'curve = { kind = "t200" }') -> str:
    path = tmp_path / "battery.toml"
    text = PRESET.read_text().replace("[every_thruster]", f"{battery}\n[every_thruster]\n{curve}")
    path.write_text(text.replace("time_constant = 0.05", ""))
    return str(path)


def test_the_voltage_solves_the_circuit(tmp_path: Path) -> None:
    """The voltage is V = E - R sum I(V); each thrust is the table's at V, less than at the open-circuit voltage."""
    vehicle, _ = load_vehicle(vehicle_file(tmp_path))
    for pulses in ((1900,) * 6, (1100,) * 6, (1700, 1300, 1500, 0, 1550, 1800), (1500,) * 6):
        thrusters = make_thrusters(vehicle, 0.0025)
        thrusters.step(pulses)
        state = thrusters.battery
        assert state is not None
        current = sum(performance(pulse, state.voltage).current for pulse in pulses)
        assert state.current == pytest.approx(current, rel=1e-12)
        assert state.voltage == pytest.approx(16.8 - 0.05 * current, rel=1e-12)
        assert thrusters.thrusts == pytest.approx([performance(p, state.voltage).thrust for p in pulses])
    full = make_thrusters(vehicle, 0.0025)
    full.step((1900,) * 6)
    assert full.battery is not None
    assert 11.5 < full.battery.voltage < 12.5
    assert full.thrusts[0] < 0.8 * performance(1900, 16.8).thrust


def test_rpm_and_current_are_those_of_the_table_at_the_battery_voltage(tmp_path: Path) -> None:
    vehicle, _ = load_vehicle(vehicle_file(tmp_path))
    thrusters = make_thrusters(vehicle, 0.0025)
    pulses = (1700, 1300, 1500, 1900, 1100, 1600)
    thrusters.step(pulses)
    battery = thrusters.battery
    assert battery is not None
    motors = thrusters.motors(pulses)
    assert sum(current for _, current in motors) == pytest.approx(battery.current)
    assert [speed for speed, _ in motors[:2]] == pytest.approx(
        [performance(1700, battery.voltage).rpm * math.pi / 30, -performance(1300, battery.voltage).rpm * math.pi / 30]
    )
    assert motors[2] == pytest.approx((0.0, 0.0), abs=0.1)
    thrusters.fail([Failure(vehicle.thrusters[0].name, "off")])
    thrusters.step(pulses)
    assert thrusters.motors(pulses)[0] == (0.0, 0.0)
    assert thrusters.motors(pulses)[1][1] > 0.5


def test_without_a_battery_rpm_and_current_are_those_of_the_supply(tmp_path: Path) -> None:
    vehicle, _ = load_vehicle(vehicle_file(tmp_path, battery=""))
    (speed, current), *_ = make_thrusters(vehicle, 0.0025).motors((1700,) * 6)
    expected = performance(1700, 16.0)
    assert (speed, current) == pytest.approx((expected.rpm * math.pi / 30, expected.current))
    plain = make_thrusters(load_vehicle("bluerov2")[0], 0.0025).motors((1700,) * 6)
    assert all(math.isnan(value) for motor in plain for value in motor)


@pytest.mark.parametrize("resistance", [0.0, 0.05, 0.5])
def test_the_battery_energy_is_balanced(resistance: float) -> None:
    """The cells give, from full to empty, what the load gets plus what the resistance heats."""
    battery = parse({**TABLE, "capacity_wh": 20.0, "resistance": resistance, "hotel_current": 1.0}, Battery, "test")
    pack = BatteryPack(battery)
    amperes = [performance(1700, volts).current * 2.0 for volts in VOLTS]
    dt, energy, load, heat, charge = 0.05, 0.0, 0.0, 0.0, 0.0
    while not pack.state.cut_off:
        before = pack.open_circuit
        pack.step(VOLTS, amperes, dt)
        voltage, current, *_ = pack.state
        energy += before * current * dt
        load += voltage * current * dt
        heat += resistance * current * current * dt
        charge += current * dt
    assert energy == pytest.approx(load + heat, rel=1e-12)
    assert energy / 3600.0 == pytest.approx(20.0, rel=2e-4)
    assert charge / 3600.0 == pytest.approx(battery.capacity_ah, rel=2e-4)
    assert pack.state.fraction == 0.0


def test_the_circuit_is_solved_beyond_the_voltages_of_the_table() -> None:
    """The table gives 2 V, proportional below 10 V, and 25 V, where the current of 20 V holds."""
    load = [performance(1900, volts).current for volts in VOLTS]
    for volts, ohm in ((2.0, 0.1), (25.0, 0.1), (19.0, 0.01)):
        constant = {"charge": [0.0, 1.0], "open_circuit": [volts] * 2, "resistance": ohm}
        pack = BatteryPack(parse({**TABLE, **constant}, Battery, "test"))
        assert pack.state == (volts, 0.0, 1.0, False)
        pack.step(VOLTS, load, 0.01)
        assert pack.state.current == pytest.approx(performance(1900, pack.state.voltage).current)
        assert pack.state.voltage == pytest.approx(volts - ohm * pack.state.current)


@pytest.mark.parametrize(("key", "seconds"), [("", 1.0), ("cut_off_delay = 0.25", 0.25), ("cut_off_delay = 0", 0.0)])
def test_voltage_sag_cuts_off_permanently_after_its_delay(key: str, seconds: float, tmp_path: Path) -> None:
    """The delay is of one sag without a break, not of several that add up; then it stays off."""
    vehicle, _ = load_vehicle(vehicle_file(tmp_path, TOML.replace("cut_off = 11.0", f"cut_off = 14.5\n{key}")))
    dt = 0.0025
    thrusters = make_thrusters(vehicle, dt)

    def run(pulse: int, count: int) -> bool:
        for _ in range(count):
            thrusters.step((pulse,) * 6)
        assert thrusters.battery is not None
        return thrusters.battery.cut_off

    within = round(seconds / dt)
    for _ in range(3):
        assert not run(1900, max(0, within - 1))
        assert not run(1600, 1)
        assert thrusters.thrusts[0] > 5.0
    assert not run(1600, 1)
    assert run(1900, within + 2)
    thrusters.step((1600,) * 6)
    assert thrusters.battery is not None
    assert thrusters.thrusts == [0.0] * 6
    assert thrusters.battery.current == 0.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"charge": [0.0, 1.0]}, "2 charge and 3 open_circuit"),
        ({"charge": [0.1, 0.2, 1.0]}, "begins with 0"),
        ({"charge": [0.0, 0.0, 1.0]}, "charge: each must be greater"),
        ({"open_circuit": [12.0, 11.0, 16.0]}, "open_circuit: falls"),
    ],
)
def test_wrong_batteries_are_reported(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match="battery") as caught:
        parse({**TABLE, **changes}, Battery, "test.toml: battery")
    assert message in str(caught.value)


def test_a_battery_needs_a_thruster_with_a_current(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"battery: no thruster draws from it"):
        load_vehicle(vehicle_file(tmp_path, curve=""))
    with pytest.raises(ConfigError, match=r"battery: expected a table"):
        load_vehicle(vehicle_file(tmp_path, battery="battery = 3"))
