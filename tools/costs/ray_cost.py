"""Measure the time of rays against the seabed: in C, in plain Python, and in Embree, in one run.

    python tools/costs/ray_cost.py [--rounds 15]

The world is 512 m x 512 m of rough seabed in cells of 1 m, with three spheres, three boxes and three cylinders; the
sensors are 5 m above the seabed. Embree, where `embreex` and `trimesh` are installed, gets the same seabed as 522 242
triangles and the solids as meshes; it computes in 32-bit floats. C and Embree run in turn; a figure is the processor
time of the best round, as other processes can only add. Ratios are what to compare: times depend on the machine.

After the rays come whole samples of sensors, with the rays in C.
"""

import argparse
import sys
import time
from array import array
from collections.abc import Callable, Iterator, Sequence
from math import cos, inf, pi, radians, sin, sqrt, tan
from pathlib import Path
from random import Random
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from sim.dynamics import State
from sim.environment.obstacles import Box, Cylinder
from sim.environment.relief import Fractal
from sim.environment.terrain import Terrain, covering
from sim.environment.world import World
from sim.rays.scene import Engine, RayScene
from sim.rays.solids import sphere
from sim.sensors.imaging.camera.model import CameraModel
from sim.sensors.imaging.camera.sensor import Camera
from sim.sensors.imaging.forward_sonar import ForwardSonar, ForwardSonarModel
from sim.sensors.imaging.side_scan import SideScan, SideScanModel
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene, Sensor
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle

EXTENT = (0.0, 511.0, 0.0, 511.0)
ALTITUDE = 5.0
SPHERES = [((270.0, 262.0), 2.0), ((250.0, 280.0), 3.0), ((262.0, 240.0), 1.5)]
CYLINDERS = [((265.0, 270.0), 1.0), ((245.0, 250.0), 2.0), ((280.0, 250.0), 1.5)]
BOXES = [((275.0, 270.0), 4.0, 0.3), ((240.0, 265.0), 6.0, 1.0), ((262.0, 225.0), 5.0, -0.7)]
PLACE = (256.0, 256.0)
FEW = 400  # rays of a case that plain Python casts

Place = tuple[float, float, float]
Rays = tuple["array[float]", float]  # directions, reach in m
Cast = Callable[[], object]
Prepare = Callable[[Place, Rays], Cast]


def fan(azimuths: int, width: float, elevations: int, low: float, high: float) -> "array[float]":
    """Return unit vectors in NED: `azimuths` over `width` rad about north, elevations (rad, down) `low` to `high`."""
    directions = array("d")
    for i in range(azimuths):
        for j in range(elevations):
            azimuth = (i / azimuths - 0.5) * width
            down = low + (high - low) * (j / (elevations - 1) if elevations > 1 else 0.5)
            directions.extend((cos(azimuth) * cos(down), sin(azimuth) * cos(down), sin(down)))
    return directions


def image(columns: int, rows: int, width: float, tilt: float) -> "array[float]":
    """Return the rays of a camera with square pixels, `width` rad wide, that looks `tilt` rad down."""
    directions, half = array("d"), tan(0.5 * width)
    for i in range(rows):
        for j in range(columns):
            right, below = half * (2.0 * j / (columns - 1) - 1.0), half * (2.0 * i - rows + 1.0) / (columns - 1)
            ahead, down = cos(tilt) - below * sin(tilt), sin(tilt) + below * cos(tilt)
            length = sqrt(ahead * ahead + right * right + down * down)
            directions.extend((ahead / length, right / length, down / length))
    return directions


def cases() -> Iterator[tuple[str, Rays]]:
    """Name, rays and reach of each sensor."""
    yield "DVL, 4 beams, 100 m", (fan(4, 2.0 * pi, 1, radians(65), radians(65)), 100.0)
    yield "2-D laser, 360 beams, 50 m", (fan(360, 2.0 * pi, 1, 0.0, 0.0), 50.0)
    yield "profiler, 512 beams, 250 m", (fan(512, radians(120), 1, radians(10), radians(10)), 250.0)
    yield "forward-looking sonar, 512 x 8, 50 m", (fan(512, radians(130), 8, 0.0, radians(20)), 50.0)
    yield "forward-looking sonar, 512 x 32, 50 m", (fan(512, radians(130), 32, 0.0, radians(20)), 50.0)
    yield "depth image, 320 x 240, 30 m", (image(320, 240, radians(80), radians(35)), 30.0)


def make_world() -> World:
    """Return the rough seabed with what stands on it, but for the spheres."""
    grid = covering(EXTENT, 1.0)
    terrain = Terrain(grid, Fractal(20.0, 2.0, 0.8, seed=1).depths(grid), 20.0)
    cylinders = tuple(Cylinder(*at, radius, top=10.0) for at, radius in CYLINDERS)
    boxes = tuple(Box(*at, size, size, heading, top=12.0) for at, size, heading in BOXES)
    return World("rough", "made up", EXTENT, 20.0, cylinder=cylinders, box=boxes, terrain=terrain)


def balls(world: World) -> list[tuple[Place, float]]:
    """Return centres and radii of the spheres, which lie on the seabed."""
    return [((*at, world.seabed(*at) - 0.5 * radius), radius) for at, radius in SPHERES]


def prepare_own(world: World, engine: Engine) -> Prepare:
    """Return a caster with one of our engines."""
    scene = RayScene(world, engine)
    for center, radius in balls(world):
        scene.add(sphere(center, radius))
    return lambda origin, rays: lambda: scene.ranges(origin, *rays)


def embree(world: World) -> Prepare | None:
    """Return Embree; None where it is not installed."""
    try:
        import numpy as np
        import trimesh
        from embreex import mesh_construction, rtcore_scene
    except ImportError:
        return None
    scene = rtcore_scene.EmbreeScene()
    triangles = np.concatenate([_seabed_triangles(world), *_solid_triangles(world, trimesh)])
    mesh_construction.TriangleMesh(scene, triangles.astype(np.float32))

    def prepare(origin: Place, rays: Rays) -> Cast:
        directions = np.frombuffer(rays[0]).reshape(-1, 3).astype(np.float32)
        origins = np.repeat(np.array([origin], np.float32), len(directions), axis=0)
        reach = np.full(len(directions), rays[1], np.float32)
        return lambda: scene.run(origins, directions, reach, query="DISTANCE")

    return prepare


def _seabed_triangles(world: World) -> Any:
    """Return the seabed as triangles, two a cell."""
    import numpy as np

    assert world.terrain is not None
    grid = world.terrain.grid
    north, east = np.meshgrid(np.arange(grid.rows), np.arange(grid.columns), indexing="ij")
    nodes = np.stack([north, east, np.array(world.terrain.depths).reshape(north.shape)], axis=-1)
    a, b, c, d = nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, :-1], nodes[1:, 1:]
    return np.concatenate([np.stack(corners, axis=2).reshape(-1, 3, 3) for corners in ((a, b, c), (b, d, c))])


def _solid_triangles(world: World, trimesh: Any) -> Iterator[Any]:
    deep = 30.0
    for center, radius in balls(world):
        yield trimesh.creation.icosphere(subdivisions=4, radius=radius).triangles + center
    for at, radius in CYLINDERS:
        mesh = trimesh.creation.cylinder(radius, deep - 10.0, sections=64)
        yield mesh.apply_translation((*at, 0.5 * (deep + 10.0))).triangles
    for at, size, heading in BOXES:
        turned = trimesh.transformations.rotation_matrix(heading, (0, 0, 1))
        mesh = trimesh.creation.box((size, size, deep - 12.0), turned)
        yield mesh.apply_translation((*at, 0.5 * (deep + 12.0))).triangles


def thinned(rays: Rays) -> Rays:
    """Return at most FEW of the rays, evenly chosen: enough for the time of plain Python."""
    directions, reach = rays
    count = len(directions) // 3
    chosen = Random(1).sample(range(count), min(count, FEW))
    return array("d", [x for i in chosen for x in directions[3 * i : 3 * i + 3]]), reach


def race(casts: Sequence[Cast], rounds: int, repeat: int = 1) -> list[float]:
    """Return microseconds of processor time of each cast, `repeat` at a time, in turn: the best of the rounds."""
    best = [inf] * len(casts)
    for _ in range(rounds):
        for i, cast in enumerate(casts):
            began = time.process_time()
            for _ in range(repeat):
                cast()
            best[i] = min(best[i], (time.process_time() - began) / repeat * 1e6)
    return best


def figures(rays: Rays, rounds: int, engines: dict[str, Prepare], origin: Place) -> str:
    """Return a line of the table."""
    count, few = len(rays[0]) // 3, thinned(rays)
    quick = [engines[name](origin, rays) for name in ("C", "Embree") if name in engines]
    cost = race(quick, rounds, max(1, 4000 // count))
    (plain,) = race([engines["python"](origin, few)], 3)
    line = f"{count:7}{cost[0] * 1e-3:9.3f}{cost[0] / count:9.3f}{plain / (len(few[0]) // 3):10.2f}"
    if len(cost) > 1:
        line += f"{cost[1] / count:10.3f}{cost[0] / cost[1]:9.2f}"
    return line


def whole_sensors() -> Iterator[tuple[str, Callable[[Scene], Sensor]]]:
    """Name and maker of each sensor that makes images."""
    down = Mounting(orientation=(0.0, -radians(10.0), 0.0))
    camera = Mounting(orientation=(0.0, -radians(35.0), 0.0))
    yield "forward-looking sonar, 512 beams", lambda scene: ForwardSonar(ForwardSonarModel(), down, 1, scene)
    yield "side-scan sonar, 2 x 1000 bins", lambda scene: SideScan(SideScanModel(), Mounting(), 1, scene)
    yield "camera with depth, 320 x 240", lambda scene: Camera(CameraModel(), camera, 1, scene)


def sensor_figures(name: str, make: Callable[[Scene], Sensor], world: World, rounds: int) -> str:
    """Return one line of the table of whole sensors."""
    position = (*PLACE, world.seabed(*PLACE) - ALTITUDE)
    sensor = make(Simulation(load_vehicle("bluerov2_heavy")[0], world, {}, position=position))
    state = State(position)
    return f"{name:38}{race([lambda: sensor.sample(0, state)], rounds)[0] * 1e-3:9.2f}"


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=15, help="rounds a figure [%(default)s]")
    options = parser.parse_args()
    rounds, world = options.rounds, make_world()
    engines: dict[str, Prepare] = {
        "C": prepare_own(world, "C"),
        "python": prepare_own(world, "python"),
    }
    if peer := embree(world):
        engines["Embree"] = peer
    print(f"{'us a ray (C: all rays in ms too)':38}   rays     C ms        C    Python    Embree C/Embree")
    for name, rays in cases():
        print(f"{name:38}{figures(rays, rounds, engines, (*PLACE, world.seabed(*PLACE) - ALTITUDE))}")
    print(f"\n{'a whole sample':38}       ms")
    for name, make in whole_sensors():
        print(sensor_figures(name, make, world, rounds))
    return 0


if __name__ == "__main__":
    sys.exit(main())
