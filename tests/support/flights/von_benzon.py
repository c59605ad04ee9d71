"""The BlueROV2 Heavy of von Benzon 2022: its files of states and trajectories, and the forces of these."""

import csv
from collections.abc import Callable, Iterator, Sequence
from math import sin
from pathlib import Path

from sim.matrices import cross_matrix, product, square
from sim.rotations import Rotation
from sim.vehicle.vehicle import load_vehicle

VECTORS = Path(__file__).parents[2] / "vectors"
HEAVY, _ = load_vehicle("bluerov2_heavy_vonbenzon2022")
ADDED = square(HEAVY.added_mass, 6)
DENSITY, GRAVITY = 1000.0, 9.82
DEEP = 1000.0
CURRENT = (0.3, 0.2, 0.0)  # of the drift

Row = dict[str, str]
Wrench = tuple[float, float, float, float, float, float]


def rows_of(name: str) -> Iterator[Row]:
    with (VECTORS / name).open() as file:
        yield from csv.DictReader(line for line in file if not line.startswith("#"))


def pick(row: Row, keys: str) -> list[float]:
    return [float(row[key]) for key in keys.split()]


class LeftOut:
    """The force that those authors leave out in a current, taken away.

    In turning axes the water's own velocity turns, so nu_r' = nu' + omega x (R' current), and the added mass
    feels that; they take nu_r' for nu'.
    """

    def __init__(self, current: Sequence[float]) -> None:
        self.current = current

    def begin(self, time_ns: int) -> None:
        """Do nothing: it does not change with time."""

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> list[float]:
        xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation
        north, east, down = self.current
        water = [[xx * north + yx * east + zx * down], [xy * north + yy * east + zy * down],
                 [xz * north + yz * east + zz * down]]  # fmt: skip
        turning = [*product(cross_matrix(nu_r[3:]), water), [0.0], [0.0], [0.0]]
        return [row[0] for row in product(ADDED, turning)]


def sines(t: float) -> Wrench:
    return (
        30.0 * sin(0.7 * t), 25.0 * sin(0.9 * t + 1.0), 20.0 * sin(0.5 * t + 2.0),
        0.6 * sin(1.3 * t), 0.6 * sin(1.1 * t + 0.5), 2.0 * sin(0.8 * t + 0.3),
    )  # fmt: skip


def from_one_second(*wrench: float) -> Callable[[float], Wrench]:
    x, y, z, k, m, n = wrench
    return lambda t: (x, y, z, k, m, n) if t >= 1.0 - 1e-9 else (0.0,) * 6


CASES: dict[str, Callable[[float], Wrench]] = {
    "all_axes_sines": sines,
    "current_drift_0p3_0p2": from_one_second(0, 0, 0, 0, 0, 0),
    "heave_120N": from_one_second(0, 0, 120, 0, 0, 0),
    "roll_release_20deg": from_one_second(0, 0, 0, 0, 0, 0),
    "surge_85N": from_one_second(85, 0, 0, 0, 0, 0),
    "surge_yaw_40N_3Nm": from_one_second(40, 0, 0, 0, 0, 3),
    "sway_85N": from_one_second(0, 85, 0, 0, 0, 0),
    "yaw_10Nm": from_one_second(0, 0, 0, 0, 0, 10),
}
