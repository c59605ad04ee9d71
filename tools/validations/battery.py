"""A battery under the load of its thrusters, compared with the equations of its circuit."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes

from hil.common.schema import parse
from sim.assembly import make_thrusters
from sim.vehicle.battery import Battery, BatteryPack
from sim.vehicle.thrusters.t200 import VOLTS, performance
from sim.vehicle.vehicle import Vehicle, load_vehicle
from tests.unit.sim.vehicle import test_battery as supply
from tools.validations.sheet import SHADES, Finding, Sheet, below, label, near, plot_own, plot_ref


def battery(panels: Sequence[Axes]) -> list[Finding]:
    """Two and six T200 on one pack of 16.8 V and 0.05 Ω. First: the voltage under the currents of all thrusters.
    Second: the thrust at that voltage. Third: two T200 run a pack of 20 Wh empty."""
    with tempfile.TemporaryDirectory() as folder:
        vehicle, _ = load_vehicle(supply.vehicle_file(Path(folder)))
    voltage, thrust, empty = panels
    return [*_sag(voltage, thrust, vehicle), _emptied(empty)]


def _sag(voltage: Axes, thrust: Axes, vehicle: Vehicle) -> list[Finding]:
    pulses, away = list(range(1500, 1901, 10)), 0.0
    for count, color in ((2, SHADES[2]), (6, SHADES[0])):
        volts, thrusts, solved = [], [], []
        for pulse in pulses:
            thrusters = make_thrusters(vehicle, 0.0025)
            thrusters.step((pulse,) * count + (1500,) * (6 - count))
            state = thrusters.battery
            assert state is not None
            volts.append(state.voltage)
            thrusts.append(thrusters.thrusts[0])
            solved.append(16.8 - 0.05 * count * performance(pulse, state.voltage).current)
        away = max(away, *(abs(a / b - 1.0) for a, b in zip(volts, solved, strict=True)))
        plot_own(voltage, pulses, volts, f"ours, {count} thrusters", color)
        plot_ref(voltage, pulses[::4], solved[::4], "16.8 V - 0.05 Ω × table's current" if count == 6 else "_")
        plot_own(thrust, pulses, thrusts, f"ours, {count} thrusters", color)
    full = [performance(pulse, 16.8).thrust for pulse in pulses]
    plot_ref(thrust, pulses[::2], full[::2], "table, 16.8 V")
    label(voltage, "pulse (µs)", "voltage (V)", legend="lower left")
    label(thrust, "pulse (µs)", "thrust of each (N)", legend="upper left")
    return [
        below("voltage away from that of the circuit (share)", away, 1e-12),
        below("thrust of six at full pulse, of that without sag", thrusts[-1] / full[-1], 0.8),
    ]


def _emptied(axes: Axes) -> Finding:
    pack = BatteryPack(parse({**supply.TABLE, "capacity_wh": 20.0, "hotel_current": 1.0}, Battery, "battery"))
    amperes, dt = [performance(1700, volts).current * 2.0 for volts in VOLTS], 0.05
    energy = 0.0
    times: list[float] = []
    volts, open_circuit = [], []
    while not pack.state.cut_off:
        before = pack.open_circuit
        pack.step(VOLTS, amperes, dt)
        times.append(dt * len(times) / 60.0)
        volts.append(pack.state.voltage)
        open_circuit.append(before)
        energy += before * pack.state.current * dt
    plot_own(axes, times[:-1:20], volts[:-1:20], "ours, at the terminals")
    plot_ref(axes, times[::600], open_circuit[::600], "open circuit, by the charge left")
    label(axes, "time (min)", "voltage (V)", "two T200 at 1700 µs", legend="lower left")
    what = "energy of the cells from full to empty"
    return near(what, energy / 3600.0, 20.0, "Wh", rel=2e-4)


SHEETS = [Sheet("Battery", battery, columns=3, size=(9.5, 2.8))]
