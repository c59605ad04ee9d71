"""The T200 thruster's public performance data: thrust, current, power and speed over pulse and voltage.

Blue Robotics, "T200 Public Performance Data 10-20 V", September 2019. `sim/data/t200.csv` contains every fifth of the
published pulses and all of those at the edges of the dead band, with linear interpolation over pulse and voltage. No
data are published below 10 V: there all quantities are assumed to be proportional to the voltage.
"""

import os
from bisect import bisect_right
from functools import cache
from typing import NamedTuple

from hil.common.schema import preset_folder
from sim.interpolation import interpolate, nearest_pulse

Rows = tuple[list[float], list[float], list[float]]


class Performance(NamedTuple):
    """Operating point of one T200: thrust (N, negative in reverse), current (A), power taken (W), speed (rev/min)."""

    thrust: float
    current: float
    power: float
    rpm: float


def _read() -> tuple[list[float], list[float], list[list[list[float]]]]:
    """Return voltages, pulses, and thrust, current, rpm as [quantity][pulse][voltage]."""
    with open(os.path.join(preset_folder("sim/data"), "t200.csv"), encoding="ascii") as file:
        lines = [line.split(",") for line in file if not line.startswith("#")]
    volts = [0.0] + [float(name.split("V")[0]) for name in lines[0][1::3]]
    numbers = [[float(cell) for cell in line] for line in lines[1:]]
    columns = [[[0.0, *row[first::3]] for row in numbers] for first in (1, 2, 3)]
    return volts, [row[0] for row in numbers], columns


VOLTS, _PULSES, _COLUMNS = _read()


def rows(pwm_us: int) -> Rows:
    """Return thrusts (N), currents (A) and speeds (rev/min) of a pulse at each of VOLTS; 0 outside 800..2200 us."""
    if not 800 <= pwm_us <= 2200:
        return [0.0] * len(VOLTS), [0.0] * len(VOLTS), [0.0] * len(VOLTS)
    pulse = min(max(pwm_us, _PULSES[0]), _PULSES[-1])
    after = min(bisect_right(_PULSES, pulse), len(_PULSES) - 1)
    start, end = _PULSES[after - 1], _PULSES[after]
    share = (pulse - start) / (end - start)
    thrust, current, rpm = (
        [a + share * (b - a) for a, b in zip(column[after - 1], column[after], strict=True)] for column in _COLUMNS
    )
    return thrust, current, rpm


def performance(pwm_us: int, volts: float) -> Performance:
    """Return the operating point at a pulse of `pwm_us` microseconds and `volts` V; above 20 V that of 20 V."""
    thrust, current, rpm = (interpolate(VOLTS, row, volts) for row in rows(pwm_us))
    return Performance(thrust, current, current * volts, rpm)


def pulse_for(thrust: float, volts: float) -> int:
    """Return the pulse in us whose steady thrust at `volts` V is nearest `thrust` N; 1500 for 0."""
    return nearest_pulse(_PULSES, _thrusts(volts), thrust) if thrust else 1500


@cache
def _thrusts(volts: float) -> list[float]:
    """Return the thrust (N) of each pulse of the table; a vehicle's supply has one voltage."""
    return [interpolate(VOLTS, row, volts) for row in _COLUMNS[0]]
