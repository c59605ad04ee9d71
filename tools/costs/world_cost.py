"""Measure the cost of a large world for each part that opens it: time and private memory, each in a separate process.

    python tools/costs/world_cost.py [--side 10001] [--resolution 5] [--obstacles 500] [PART ...]

The world is made in a temporary folder: hills and ripples on `side` x `side` nodes with piles at random places; the
defaults are 50 km x 50 km at 5 m, `--resolution 1` makes it 10 km x 10 km at 1 m. The vehicle starts in the middle.
Its depths are in the page cache, as they were just written. A part's time begins when its modules are loaded and ends
with its first result. Memory is the increase from the same work in a small world: private memory, its peak, and the
mapped pages of the file of depths, which the kernel may drop. It maps 64 kB around each place that is read.
"""

import argparse
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from hil.common.children import package_environment  # noqa: E402 - works from a bare checkout too
from hil.common.scratch import ScratchFolder  # noqa: E402
from hil.scenario.config import Scenario, build_simulation, load_scenario  # noqa: E402
from sim.environment.world import World, load_world  # noqa: E402
from sim.sensors.sensor_set import Slot  # noqa: E402
from sim.vehicle.vehicle import load_vehicle  # noqa: E402

GOAL_M = 1500.0  # from the start to the north-east, each way
PARTS = (
    "world", "simulation", "camera", "camera_opengl", "forward_sonar", "side_scan", "profiler", "map", "follow",
    "any_angle", "dstar", "view", "picture",
)  # fmt: skip


def make_world(folder: str, side: int, resolution: float, obstacles: int) -> str:
    """Write the world; return its file."""
    import numpy as np

    half, east = 0.5 * (side - 1) * resolution, np.arange(side) * resolution
    with open(os.path.join(folder, "large.f32"), "wb") as file:
        for north in (np.arange(side) * resolution).tolist():
            row = 30.0 + 8.0 * np.sin(north / 300.0) + 6.0 * np.cos(east / 210.0) + 0.5 * np.sin((east + north) / 7.0)
            row.astype("<f4").tofile(file)
    positions = np.random.default_rng(1).uniform(-half, half, (obstacles, 2)).tolist()
    path = os.path.join(folder, "large.toml")
    Path(path).write_text(
        f'name = "large"\nsource = "made up"\nextent = [{-half}, {half}, {-half}, {half}]\ndepth = 40.0\n'
        f'[terrain]\nfile = "large.f32"\nnorth_min = {-half}\neast_min = {-half}\nresolution = {resolution}\n'
        f"rows = {side}\ncolumns = {side}\n"
        + "".join(f"[[cylinder]]\nnorth = {n:.2f}\neast = {e:.2f}\nradius = 1.0\n" for n, e in positions),
        encoding="utf-8",
    )
    return path


def scenario_of(world: str, sensor: str = "", **keys: Any) -> Scenario:
    """Return a scenario in that world, with one more sensor."""
    changes = {"vehicle": "bluerov2_heavy", "world": world, "master.goal": [GOAL_M, GOAL_M], "master.depth": 5.0}
    extra = {f"sensors.{sensor}.{key}": value for key, value in {"rate": 1.0, **keys}.items()} if sensor else {}
    return load_scenario("open_water", {**changes, **extra})


def _sample(sensor: str, **keys: Any) -> Callable[[str], Any]:
    """Return a function that makes a sensor's first sample."""

    def run(world: str) -> Any:
        scenario = scenario_of(world, sensor, **keys)
        vehicle, place = load_vehicle(scenario.vehicle)[0], load_world(scenario.world)
        simulation = build_simulation(scenario._replace(sensors={}), vehicle, place)
        slot = Slot(sensor, scenario.sensors[sensor], simulation, 1, 1)
        return slot, slot.sensor.sample(0, simulation.state)

    return run


def _simulate(world: str) -> Any:
    scenario = scenario_of(world)
    vehicle = load_vehicle(scenario.vehicle)[0]
    simulation = build_simulation(scenario, vehicle, load_world(scenario.world))
    for _ in range(400):
        simulation.step([thruster.pwm_neutral_us for thruster in vehicle.thrusters])
    return simulation


def _map(world: str) -> Any:
    from hil.master.flight import make_request

    scenario = scenario_of(world)
    return make_request(scenario, load_vehicle(scenario.vehicle)[0], load_world(scenario.world))


def _plan(search: str) -> Callable[[str], Any]:
    def run(world: str) -> Any:
        from hil.master.flight import prepare

        scenario = scenario_of(world)
        if search:
            planner = {"class": "hil.master.avoid:Avoid", "scan": "laser", "search": search}
            scenario = scenario._replace(planner=planner)
        return prepare(scenario)

    return run


def _view(world: str) -> Any:
    from hil.view.scene.world import nodes, triangles

    place = load_world(world)
    return place, triangles(*nodes(place))


def _picture(world: str) -> None:
    from hil.charts.grid import grid_of
    from hil.charts.picture import MapMarks, draw

    loaded: World = load_world(world)
    draw(
        grid_of(loaded),
        loaded.cylinder,
        loaded.box,
        MapMarks(),
        "large",
        os.path.join(os.path.dirname(world), "large.png"),
    )


RUNS: dict[str, Callable[[str], Any]] = {
    "world": load_world, "simulation": _simulate, "camera": _sample("camera"),
    "camera_opengl": _sample("camera", renderer="opengl"), "forward_sonar": _sample("forward_sonar"),
    "side_scan": _sample("side_scan"), "profiler": _sample("profiler"), "map": _map, "follow": _plan(""),
    "any_angle": _plan("any_angle"), "dstar": _plan("dstar"), "view": _view, "picture": _picture,
}  # fmt: skip


def measure(name: str, small: str, world: str) -> str:
    """Run a part in a small world, which loads its modules, then in the large one; return a line of the table."""
    RUNS[name](small)
    own, mapped = _memory_mb()
    with Peak() as peak:
        began = time.perf_counter()
        result = RUNS[name](world)
        duration = time.perf_counter() - began
    own_then, mapped_then = _memory_mb()
    figures = own_then - own, peak.most_mb - own, mapped_then - mapped
    del result
    return f"{name:16}{duration:8.3f}" + "".join(f"{max(0.0, figure):8.1f}" for figure in figures)


class Peak:
    """Peak of the process's private memory, read every millisecond by a thread."""

    def __enter__(self) -> "Peak":
        self.most_mb = 0.0
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._end.wait(1e-3):
            self.most_mb = max(self.most_mb, _memory_mb()[0])


def _memory_mb() -> tuple[float, float]:
    """Return the resident memory of this process: private, and of files."""
    memory = psutil.Process().memory_info()
    return (memory.rss - memory.shared) / 1e6, memory.shared / 1e6


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=10_001, help="nodes a side [%(default)s]")
    parser.add_argument("--resolution", type=float, default=5.0, help="m between nodes [%(default)s]")
    parser.add_argument("--obstacles", type=int, default=500, help="piles [%(default)s]")
    parser.add_argument("--run", nargs=3, metavar=("PART", "SMALL", "LARGE"), help="one part, in this process")
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"{', '.join(PARTS)} [all]")
    options = parser.parse_args()
    if options.run:
        print(measure(*options.run))
        return 0
    with ScratchFolder("world-cost") as scratch:
        large, small = scratch.file("large"), scratch.file("small")
        for folder in (large, small):
            os.mkdir(folder)
        least = min(options.side, round(4.0 * GOAL_M / options.resolution) + 1)
        paths = (
            make_world(small, least, options.resolution, 3),
            make_world(large, options.side, options.resolution, options.obstacles),
        )
        print(f"{'part':16}{'s':>8}{'MB':>8}{'peak':>8}{'depths':>8}")
        for name in options.parts or PARTS:
            command = [sys.executable, __file__, "--run", name, *paths]
            done = subprocess.run(command, env=package_environment(), capture_output=True, text=True, check=False)
            print(
                done.stdout.rstrip() or f"{name}: {(done.stderr.strip().splitlines() or ['no message'])[-1]}",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
