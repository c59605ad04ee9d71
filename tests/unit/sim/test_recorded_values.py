"""Functions give the recorded values for a table of arguments, as tests/unit/sim/test_recorded_runs.py for whole runs.

`python -m tests.unit.sim.test_recorded_values` records them again.
"""

import json
import tempfile
from array import array
from collections.abc import Callable, Iterator
from itertools import product
from math import cos, inf, nan, sin
from pathlib import Path
from random import Random
from re import findall
from typing import Any
from xml.etree.ElementTree import tostring

import numpy as np
import pytest

from hil.autonomy.control.allocation import pseudo_inverse
from hil.common.errors import ConfigError
from sim.dynamics import Dynamics, State
from sim.environment.bottom import Bottom
from sim.environment.collision import Contact
from sim.environment.ocean import Profile
from sim.environment.optics import jerlov
from sim.environment.relief import Fractal, Ridge, Sinusoid, Slope, Step
from sim.environment.seawater.absorption import francois_garrison
from sim.environment.seawater.water_column import WaterColumn
from sim.environment.shallows import distance_to_shallows
from sim.environment.stratification import surface_and_layers
from sim.environment.terrain import Terrain, covering
from sim.environment.texture import Texture, smooth_slopes
from sim.environment.things.shapes import KINDS, parse_shapes, place_shapes
from sim.environment.water import SampledWaves, wave_inertia
from sim.environment.wind import Wind, WindForce
from sim.environment.world import World, load_world
from sim.forces import Force
from sim.modems.acoustic import AcousticChannel, AcousticModem
from sim.modems.sound import ambient_noise, paths, thorp_absorption, transmission_loss
from sim.modems.usbl import UsblRounds
from sim.rays import solids
from sim.rays.scene import RayScene
from sim.rotations import from_euler, matrix, rotate
from sim.sdf.as_urdf import as_urdf
from sim.sensors.error import ErrorModel
from sim.sensors.imaging.camera.lamps import Lamps
from sim.sensors.imaging.camera.motion import Motion, RawPicture
from sim.sensors.imaging.range_image import RangeImageModel, RangeImager
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.beams import RangeErrors
from sim.sensors.sensor_set import SensorSpec, load_sensor
from sim.sensors.variances import error_variances
from sim.simulation import Simulation
from sim.vehicle.ballast import Bladder, BuoyancyEngine
from sim.vehicle.body_lift import CrossFlow, CrossFlowDrag, FadingDamping, HullLift, Lift, SlowDamping, SpeedDamping
from sim.vehicle.buoyancy import Hull
from sim.vehicle.collision_shape import Collision
from sim.vehicle.fins import Fin, FinSet, fin_matrix
from sim.vehicle.hydrostatics import afloat
from sim.vehicle.terminal_speed import axis_capabilities
from sim.vehicle.thrusters.azimuth import AzimuthSet
from sim.vehicle.thrusters.bank import ThrusterSet, wrench_matrix
from sim.vehicle.thrusters.curves import Advance
from sim.vehicle.thrusters.model import Azimuth
from sim.vehicle.thrusters.t200 import performance, pulse_for
from sim.vehicle.urdf.importer import read_robot, read_urdf
from sim.vehicle.urdf.text import read_xml
from sim.vehicle.urdf.writer import urdf_of
from sim.vehicle.vehicle import load_vehicle
from tests.support.processes import ROOT
from tests.unit.sim.test_recorded_runs import BAY, SEA, THINGS, figures

RECORD = ROOT / "tests" / "vectors" / "sim_values.json"
PROFILE = Profile((2.0, 10.0, 40.0, 100.0), (1018.0, 1022.0, 1026.5, 1027.0), (1512.0, 1500.0, 1485.0, 1492.0))
EXTENT = (-20.0, 20.0, -15.0, 25.0)
RELIEFS = (
    Slope(9.0, 0.3, 0.4, 1.0, -2.0, 0.5), Step(9.0, 2.0, 1.2, 1.0, 2.0, 2.0), Ridge(9.0, 3.0, 4.0, -0.7, 2.0, 1.0),
    Sinusoid(9.0, 1.5, 7.0, 0.9), Fractal(9.0, 1.2, seed=3),
)  # fmt: skip
PLACES = [(1.3, -2.2), (-14.8, 11.1), (19.0, 24.5), (40.0, 3.0), (-3.7, 60.0)]
VEHICLES = ("paper_seven", "bluerov2_heavy", "remus100", "otter", "heron", "tethys", "eca_a9", "rexrov")
NS = 1_000_000_000


def reliefs(_: Path) -> Iterator[Any]:
    for rule in RELIEFS:
        grid = covering(EXTENT, rule.resolution)
        terrain = Terrain(grid, rule.depths(grid), 8.0)
        for north, east in PLACES:
            yield terrain.depth(north, east), terrain.gradient(north, east)
            yield terrain.normal(north, east), terrain.shallowest(north, east, 3.0)
            for depth, within in ((7.6, 30.0), (8.9, 4.0)):
                yield distance_to_shallows(terrain, north, east, depth, within)


def textures(_: Path) -> Iterator[Any]:
    north, east = np.meshgrid(np.arange(0.0, 9.0, 0.7), np.arange(-4.0, 4.0, 0.9))
    for kind in ("mud", "sand", "gravel", "rock"):
        texture = Texture(Bottom(kind, ripple_height=0.05, ripple_length=0.4, ripple_heading=0.3))
        for footprint in (0.01, 0.1, 0.8):
            yield from (list(map(float, part.ravel())) for part in texture.sample(north, east, footprint))


def shapes(_: Path) -> Iterator[Any]:
    for kind in KINDS:
        for more in ({}, {"orientation": [0.2, -0.1, 0.7], "scale": 1.3, "echo": 2.0}):
            for mesh in place_shapes(
                parse_shapes([{"kind": kind, "north": 3, "east": -2, **more}], ""), lambda *_: 9.0
            ):
                yield list(mesh.triangles), list(mesh.rotation), (mesh.radius, mesh.top, mesh.bottom), mesh.net or ()
                yield mesh.keys.colour, mesh.keys.echo


def sea_water(_: Path) -> Iterator[Any]:
    for frequency, warmth, salt, depth in product((30e3, 4e5), (2.0, 25.0), (5.0, 35.0), (5.0, 900.0)):
        yield francois_garrison(frequency, warmth, salt, depth)
    for frequency, wind in product((900.0, 28e3), (2.0, 12.0)):
        yield thorp_absorption(frequency), transmission_loss(700.0, frequency, 1.4), ambient_noise(frequency, wind, 0.3)
    yield [tuple(path) for path in paths(90.0, 4.0, 9.0, 20.0, 3)]
    column = WaterColumn(PROFILE, 9.81)
    for depth in (0.0, 3.0, 25.0, 40.0, 150.0):
        yield column.density(depth), column.sound_speed(depth), column.pressure(depth)
    rays = column.rays(80.0)
    assert rays
    for level, start, end in product((0.0, 30.0, 400.0, 3000.0), (1.0, 20.0, 70.0), (2.0, 20.0, 60.0)):
        yield rays.between(level, start, end) or (-1.0,)


def modems(_: Path) -> Iterator[Any]:
    """A USBL asks two vehicles, and all talk at once at times."""
    modem = AcousticModem(bounces=2)
    places = {"ship": (0.0, 0.0, 2.0), "one": (120.0, -40.0, 18.0), "two": (-300.0, 500.0, 35.0)}
    for column in (None, WaterColumn(PROFILE, 9.81)):
        channel = AcousticChannel(modem, 50.0, 4, column)
        angle = ErrorModel(noise=0.01, offset=0.02)
        rounds = UsblRounds(channel, ["ship", "one"], ["ship", "one", "two"], 2 * NS, angle, modem.range_error, 3)
        for step in range(200):
            now = step * NS // 10
            rounds.ask(now, places)
            if step % 23 == 0:
                channel.send(now, "two", b"a longer message", places)
                channel.send(now, "one", b"x" * (70 if step == 46 else 9), places)
            others, fixes = rounds.take(now, channel.receive(now), places)
            for other in others:
                yield [value for value in other if isinstance(value, (int, float))]
            yield from ((fix.sent_ns, *fix.offset, *fix.covariance) for fix in fixes)
        yield [channel.counts[name] for name in sorted(channel.counts)]


def rays(folder: Path) -> Iterator[Any]:
    """Rays in Python, through a world with obstacles, relief, a pipeline, a mesh and solids that are added."""
    (folder / "w.toml").write_text(BAY + THINGS)
    scene = RayScene(load_world(str(folder / "w.toml")))
    scene.add(solids.sphere((4.0, 3.0, 4.0), 1.2))
    scene.add(solids.cylinder((-4.0, 2.0, 6.0), 0.8, 1.5, matrix(from_euler(0.3, 0.5, 0.1))))
    scene.add(solids.box((-2.0, -5.0, 5.0), (1.0, 2.0, 1.5), matrix(from_euler(0.1, -0.4, 0.7))))
    scene.add(solids.hull(load_vehicle("remus100")[0]), State((-2.4, -1.9, 5.0), from_euler(0.1, 0.2, 1.0)))
    fan = [(0.19 * k, -1.4 + 0.0236 * k) for k in range(120)]
    directions = array("d", [x for a, b in fan for x in (cos(a) * cos(b), sin(a) * cos(b), sin(b))])
    for origin in ((0.0, 0.0, 5.0), (6.0, 3.0, 2.0), (-5.0, 6.0, 3.0)):
        for turn in (from_euler(0.0, 0.0, 0.0), from_euler(0.4, 0.9, -2.0)):
            hits = scene.hits(origin, directions, 25.0, matrix(turn))
            yield list(hits.distances), list(hits.objects), list(hits.points), list(hits.normals)
        boxes = scene.boxes(origin, 15.0)
        yield [part.ravel().tolist() for part in boxes]


def vehicles(folder: Path) -> Iterator[Any]:
    for name in VEHICLES:
        vehicle, _ = load_vehicle(name)
        yield axis_capabilities(vehicle, pseudo_inverse(wrench_matrix(vehicle))[0], 1025.0, 9.81)
        path = folder / f"{name}.urdf"
        path.write_text(urdf_of(vehicle, "a/"))
        yield numbers(path.read_text())
        yield read_urdf(str(path))[0]
    yield read_urdf(str(ROOT / "tests" / "vectors" / "hydra.urdf"))[0]
    for pulse, volts in product((1100, 1300, 1490, 1520, 1700, 1900), (11.0, 14.8, 20.0)):
        yield performance(pulse, volts), pulse_for(performance(pulse, volts).thrust, volts)


WATER = (
    '<gazebo><link name="hull"><volume>0.02</volume><hydrodynamic_model>{}</hydrodynamic_model></link></gazebo></robot>'
)
CHANGES = [  # of the model with the tags of all simulators, which then lacks limits, a volume, a mass, a hull ...
    ("Polynomial>", "_>"), ("libBuoyancyPlugin", "x"), ('<mass value="24"/>', ""), ("gz-sim-hydrodynamics", "x"),
    ("_motor", "_m"), ('type="continuous"', 'type="fixed"'), ("box size", "ball size"), ('izz="1.4"', 'izz="9"'),
    ("0 1.5 0", "0 0 0"), ("<limit", "<no"), ("0.1 1.4 0.3", "0 0 0"),
    *[("</robot>", WATER.format(shape)) for shape in (
        "<type>spheroid</type><radius>0.3</radius><length>0.2</length>", "<type>cylinder</type>", "<type>sphere</type>",
        "<type>ellipsoid</type>", "<type>box</type><cd>1.2</cd>", "<type>cylinder</type><radius>0.02</radius>",
        "<type>cylinder</type><axis>j</axis><radius>0.2</radius>",
        "<linear_damping_forward_speed>0 0 0 0 0 0</linear_damping_forward_speed>",
    )],
]  # fmt: skip


def numbers(text: str) -> list[float]:
    return [float(found) for found in findall(r"-?\d+\.?\d*(?:e[-+]\d+)?", text)]


def imports(_: Path) -> Iterator[Any]:
    """Models of simulators: every tag of vehicles and sensors, and what follows if some are not there."""
    mixed = (RECORD.parent / "imported.urdf").read_text()
    for old, new in CHANGES:
        try:
            found = read_robot(read_xml("m.urdf", mixed.replace(old, new).encode()), "m.urdf")
            yield from (len(found.notes), *numbers(repr(found.vehicle)))
        except ConfigError as error:
            yield str(error).count(", ")  # between what is missing
    yield from numbers(repr(found.sensors))


def sdf(_: Path) -> Iterator[Any]:
    """Models in each other, in a world that was saved: every number of the robot that is made of them."""
    path, notes = RECORD.parent / "otter" / "nested.sdf", list[str]()
    saved = path.read_text()
    for text in (saved, saved.replace("state>", "other>")):
        for name in ("rig", "parked"):
            robot = tostring(as_urdf(str(path), notes, name, text.encode())).decode()
            yield from (len(robot.replace(str(ROOT), "")), len(notes), *numbers(robot.replace(str(ROOT), "")))


def forces(folder: Path) -> Iterator[Any]:
    """Every force in Python, of a vehicle without any symmetry, above, at and below the surface, ahead and astern."""
    (folder / "w.toml").write_text(BAY + SEA)
    world = load_world(str(folder / "w.toml"))
    vehicle = load_vehicle("bluerov2_heavy")[0]._replace(
        center_of_buoyancy=(0.02, -0.03, -0.05), dimensions=(1.2, 0.5, 0.4), center_of_gravity=(0.1, 0.02, 0.03)
    )
    waves = SampledWaves(world.ocean.waves, world, 3, vehicle.dimensions)  # type: ignore[union-attr,arg-type]
    lift = Lift(0.2, aspect_ratio=0.4, parasitic_drag=0.05, stall_angle=0.3, position=(-0.3, 0.1, 0.05))
    fin = Fin("f", (-0.5, 0.2, 0.1), (0.1, 0.3, -2.0), 0.02, 0.5, (1.0, 0.2, 0.1), 2.0, straightening=0.7)
    turning = [
        one._replace(azimuth=Azimuth(1.5), torque=0.02, position=(0.2, -0.3, 0.1 * n), direction=(0.8, 0.5, 0.1))
        for n, one in enumerate(vehicle.thrusters)
    ]
    fins, azimuths = FinSet([fin, fin._replace(chord=(-1.0, 0.0, 0.2))], 1020.0, 0.01), AzimuthSet(turning, 0.01)
    azimuths.read_thrusts = lambda: [3.0 * n - 7.0 for n in range(len(turning))]
    engine = BuoyancyEngine((0.3, -0.1, 0.2), 1e-4, 3e-4, 7e-4, 5e-3)
    bladder = Bladder(engine, 9810.0, 0.01)
    acting: list[Force] = [
        HullLift(lift, 1020.0), HullLift(lift._replace(plane="vertical"), 1020.0), fins, azimuths, bladder,
        CrossFlowDrag(CrossFlow((1.1, 0.7), (0.2, 0.6)), (1.6, 0.3, 0.2), 1020.0), SpeedDamping(range(36)),
        SlowDamping(FadingDamping((1.0, 2.0, 3.0, 4.0, 5.0, 6.0), 2.0, 1.5)),
        WindForce(vehicle, Wind(8.0, 2.0, 0.2, components=3), waves.wave_field, 7),
        *surface_and_layers(vehicle, world, waves.wave_field),
    ]  # fmt: skip
    hull, advance = Hull(vehicle, 1020.0, 9.81), Advance(0.1, 20.0, 0.4, 0.3, 0.2, 0.1)
    advancing = ThrusterSet(vehicle._replace(thrusters=tuple([one._replace(curve=advance) for one in turning])), 0.01)
    for step, (depth, turn, speed) in enumerate(product((-0.9, -0.1, 0.2, 1.4), (0.2, 2.6), (0.6, -1.3))):
        for servos in (fins, azimuths):
            servos.step([1400 + 40 * step + 50 * n for n in range(len(servos.angles))])
        bladder.step(1450 + 20 * step)
        advancing.step([1200 + 70 * n for n in range(8)], (speed, 0.3, -0.4, 0.2, -0.3, 0.5))
        yield advancing.thrusts
        position, attitude = (3.0 + step, -2.0, depth), matrix(from_euler(0.3 * turn, -0.2, turn))
        nu = (speed, 0.3 * turn, -0.4, 0.2, -0.3, 0.5)
        yield waves.motion(70 * step * NS // 1000, position, attitude)
        yield hull.buoyancy(depth, (0.1 * turn, -0.2, 1.0)), waves.wave_field.surface(0.07 * step, 3.1, -2.2)
        for force in acting:
            force.begin(70 * step * NS // 1000)
            yield force.wrench(position, attitude, nu)
    yield afloat(vehicle, 1020.0, 9.81) or 0.0
    yield wave_inertia(vehicle, 1020.0), fin_matrix([fin], 1020.0), hull.numbers()


def collisions(folder: Path) -> Iterator[Any]:
    """Hulls of every shape that move into obstacles, relief, cells without data and the edge of the grid."""
    vehicle, _ = load_vehicle("paper_six")
    inverse_mass = Dynamics(vehicle, 1020.0, 9.81).inverse_mass
    grid = covering((-9.0, 9.0, -9.0, 9.0), 1.0)
    holed = Terrain(grid, array("f", [nan if n % 29 == 3 else 7.0 + 0.1 * (n % 4) for n in range(361)]), 5.0)
    worlds = [World("holes", "test", EXTENT, 5.0, terrain=holed)]
    for text in (BAY, BAY + THINGS):
        (folder / "w.toml").write_text(text)
        worlds.append(load_world(str(folder / "w.toml")))
    spheres = Collision("spheres", ((0.3, 0.0, 0.1, 0.2), (-0.4, 0.1, 0.0, 0.15)), 0.0, 0.0)
    yield [bool(Collision("spheres", ((0.0, 0.0, 0.0, 0.1),) * count).validate()) for count in (0, 32, 33)]
    for world, keys in product(worlds, (Collision(), Collision("capsule", restitution=0.5), spheres)):
        contact = Contact(vehicle._replace(collision=keys), world, inverse_mass, 0.1)
        random = Random(len(world.name))
        for _ in range(12):
            at = random.uniform(-9.0, 9.0), random.uniform(-9.0, 9.0), world.seabed(0.0, 0.0) - random.uniform(0.0, 6.0)
            nu = [random.uniform(-2.0, 2.0) for _ in range(6)]
            state = State(at, from_euler(*[random.uniform(-0.5, 0.5) for _ in range(3)]), nu)
            state.nu_dot = [0.3, -0.2, 0.1, 0.1, 0.2, -0.1]
            for _ in range(4):
                moved = rotate(state.quaternion, state.nu[:3])
                state.position = [a + 0.1 * b for a, b in zip(state.position, moved, strict=True)]
                if contact.resolve(state):
                    yield *state.position, len(contact.what), contact.count
                    yield state.quaternion
                    yield state.nu
                    yield contact.impulse
                yield contact.is_inside(state), *contact.clearance()


def cameras(_: Path) -> Iterator[Any]:
    """Parts of a camera's picture: the flow of its points, the veil of its lamps, and smooth slopes."""
    lens = np.array([(1.0, 0.2 * k % 1.3 - 0.6, 0.3 * k % 1.1 - 0.5) for k in range(20)], np.float32)
    ranges, toward = np.linspace(0.3, 4.1, 20, dtype=np.float32), lens / np.linalg.norm(lens, axis=1)[:, None]
    raw = RawPicture(np.outer(ranges, (1.0, 2.0, 3.0)).astype(np.float32), ranges, np.arange(20, dtype=np.int32))
    mounting = Mounting((0.2, 0.1, 0.3), (0.1, -0.3, 0.4))
    for exposure, readout in ((0.0, 0.2), (0.3, 0.0), (0.01, 0.02), (1.5, 0.4)):
        motion = Motion((5, 4), 30.0, toward, exposure, readout)
        moved = motion.apply(raw, mounting, (0.4, -0.3, 0.2, 0.3, -0.2, 0.5))
        yield from (moved.radiance.tolist(), moved.ranges.tolist(), moved.objects.tolist())
    for lamps in (Lamps(0.3, 500.0, False, 3.0, 8.0), Lamps(0.1, 500.0, False, 1.0, 0.2)):
        yield [float(x) for x in lamps.veil(ranges, toward[:, 1], jerlov("7C")).ravel()]
    terrain = Terrain(covering(EXTENT, 2.0), RELIEFS[4].depths(covering(EXTENT, 2.0)), 8.0)
    for part in smooth_slopes(terrain, np.arange(-22.0, 23.0, 3.7), np.arange(26.0, -19.0, -3.7)):
        yield part.tolist()


def sensor_errors(folder: Path) -> Iterator[Any]:
    (folder / "w.toml").write_text(BAY + SEA)
    world = load_world(str(folder / "w.toml"))
    for name in ("imu", "ahrs", "odometry", "magnetometer", "pressure", "altimeter", "echosounder", "dvl_water"):
        sensor = load_sensor(name)
        keys = [key for key, value in sensor.Model()._asdict().items() if isinstance(value, ErrorModel)]
        errors = dict.fromkeys(keys, ErrorModel(0.1, 0.2, 0.05, 20.0, 0.03, 0.01, 0.02))
        for model in (sensor.Model(), sensor.Model(**errors)):
            found = error_variances({name: SensorSpec(sensor, model)}, world)
            yield [x for row in found.values() for x in row]
    many = ErrorModel(0.1, 0.2, 0.05, 20.0, 0.03, 0.0, 0.02, 0.001, 9.5, noise_share=0.01, outliers=0.3, outlier=0.5)
    far = RangeErrors(many, 0.1, Random(2), (0.5, 11.0))
    for _ in range(9):
        yield far.measure((0.2, 3.0, 9.0, 10.8, 11.5, inf))


def sonar_pictures(folder: Path) -> Iterator[Any]:
    (folder / "w.toml").write_text(BAY + THINGS)
    scene = Simulation(load_vehicle("paper_six")[0], load_world(str(folder / "w.toml")), {}, position=(3.0, 1.0, 5.0))
    imager = RangeImager(
        RangeImageModel(width=24, height=12, min_range=2.0), Mounting((0.1, 0.0, 0.2), (0.0, -0.3, 0.1)), 1, scene
    )
    image = imager.sample(0, scene.state)
    yield image.ranges.ravel().tolist(), image.strengths.ravel().tolist()


TABLES: list[Callable[[Path], Iterator[Any]]] = [
    reliefs, textures, shapes, sea_water, modems, rays, vehicles, imports, sdf, forces, collisions, cameras,
    sensor_errors, sonar_pictures,
]  # fmt: skip


def values(table: Callable[[Path], Iterator[Any]], folder: Path) -> list[float]:
    found = [number for row in table(folder) for _, number in figures("", row)]
    return [float(f"{value:.9g}") for value in found]


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.__name__)
def test_functions_give_their_recorded_values(
    table: Callable[[Path], Iterator[Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("UUV_HIL_NATIVE", "0")
    assert values(table, tmp_path) == pytest.approx(json.loads(RECORD.read_text())[table.__name__], rel=1e-6, abs=1e-8)


def record() -> None:
    """Write the values of all tables."""
    with tempfile.TemporaryDirectory() as name:
        rows = ",\n".join(f'"{table.__name__}": {json.dumps(values(table, Path(name)))}' for table in TABLES)
    RECORD.write_text(f"{{\n{rows}\n}}\n")


if __name__ == "__main__":
    record()
