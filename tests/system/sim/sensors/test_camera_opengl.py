"""Camera pictures by OpenGL, compared with those by ray casting.

Rays are exact; what is drawn may differ from them by rounding to 32 bits, and at the outlines of objects by a pixel.
"""

import subprocess
import sys
from math import nan, radians, tan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.common.errors import ConfigError, MissingExtraError
from hil.common.schema import parse
from sim.dynamics import State
from sim.environment.bottom import Bottom
from sim.environment.obstacles import Box, Cylinder
from sim.environment.relief import Fractal
from sim.environment.terrain import Terrain, covering
from sim.environment.world import World
from sim.rays import opengl
from sim.rays.geometry import NOTHING, SEABED
from sim.rays.scene import RayScene
from sim.rays.solids import BOX, KIND, box, half_space, hull, sphere
from sim.rotations import from_euler, matrix
from sim.sensors.imaging.camera.model import CameraModel
from sim.sensors.imaging.camera.picture import pixel_rays
from sim.sensors.imaging.camera.sensor import Camera
from sim.sensors.imaging.samples import CameraSample, Intrinsics
from sim.sensors.mounting import Mounting
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle
from tests.support.solids import mesh

ROOT = Path(__file__).parents[4]
VEHICLE, _ = load_vehicle("bluerov2_heavy")
WIDTH, HEIGHT, FOV, REACH = 160, 120, radians(80.0), 30.0
FOCAL = 0.5 * WIDTH / tan(0.5 * FOV)
PIXELS = pixel_rays(WIDTH, HEIGHT, Intrinsics(FOCAL, FOCAL, 0.5 * (WIDTH - 1), 0.5 * (HEIGHT - 1)), (0.0,) * 5)
GROUND, EXTENT = (-24.0, 24.0, -20.0, 20.0), (-25.0, 25.0, -21.0, 21.0)
# Relative error of distances, error of normals, and the share of pixels that must keep them.
CLOSE, ALIKE, SHARE = 1e-4, 1e-3, 0.999
LENS_SHARE = 0.97  # the same with a lens that distorts, and of effects that look far from a pixel


@pytest.fixture(scope="module")
def context() -> Any:
    """Provide an OpenGL context, possibly in software; CI installs the packages for it."""
    try:
        return opengl.open_context()
    except ConfigError as error:
        pytest.skip(str(error))


def relief(holes: bool = False) -> World:
    """Return rough ground that ends a metre before the walls as a step, with objects, or with unknown places."""
    grid = covering(GROUND, 0.8)
    depths = Fractal(14.0, 2.0, 0.9, seed=3).depths(grid)
    if holes:
        for row, column in [
            (40, 30),
            (40, 31),
            (41, 30),
            (10, 5),
            (0, 25),
            (60, 50),
            *((20, k) for k in range(12, 19)),
        ]:
            depths[row * grid.columns + column] = nan
    return World(
        "rough", "test", EXTENT, 12.5, walls=True, terrain=Terrain(grid, depths, 12.5),
        cylinder=(Cylinder(6.0, 2.0, 0.4), Cylinder(-5.0, -4.0, 1.0, top=11.0)),
        box=(Box(5.0, -4.0, 2.0, 1.0, 0.6, top=10.0), Box(-8.0, 3.0, 1.0, 3.0, -0.3)),
    )  # fmt: skip


TETRAHEDRON = (
    ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
    ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
)  # fmt: skip
OTHER = (3.0, 0.5, 9.5)


def pair(world: World) -> tuple[RayScene, opengl.PictureScene, State]:
    """Return one camera by rays and one by OpenGL: water surface, ball, mesh, and a vehicle whose state is given."""
    other = State(OTHER, from_euler(0.4, -0.2, 1.0))
    scenes = RayScene(world), opengl.PictureScene(world, WIDTH, HEIGHT, FOCAL)
    for scene in scenes:
        scene.add(half_space((0.0, 0.0, 1.0), 0.0))
        scene.add(sphere((4.0, -1.5, 11.0), 0.7))
        scene.add(hull(VEHICLE), other)
        scene.add(mesh(TETRAHEDRON), State((3.0, 1.8, 11.0), from_euler(0.1, 0.2, 0.3)))
    return *scenes, other


def agree(
    rays: RayScene, drawn: RayScene, place: Any, angles: tuple[float, float, float], share: float = SHARE
) -> set[int]:
    """Assert equal results from a position (m) and roll, pitch and yaw (deg); return the visible objects."""
    turned = matrix(from_euler(*map(radians, angles)))
    one, other = (scene.hits(place, PIXELS, REACH, turned) for scene in (rays, drawn))
    objects, found = np.asarray(one.objects), np.asarray(other.objects)
    assert (objects == found).mean() >= share
    some = (objects == found) & (objects != NOTHING)
    assert np.isinf(np.asarray(other.distances)[found == NOTHING]).all()
    distances, ways = np.asarray(one.distances)[some], np.asarray(other.distances)[some]
    assert (np.abs(ways - distances) <= CLOSE * distances).mean() >= share
    for exact, near in ((one.points, other.points), (one.normals, other.normals)):
        apart = np.abs(np.asarray(exact).reshape(-1, 3) - np.asarray(near)).max(axis=1)
        assert (apart[some] < ALIKE).mean() >= share
        assert np.isnan(np.asarray(near)[found == NOTHING]).all()
    return {int(number) for number in np.unique(objects)}


# Where from, how it looks, and what it sees at least: 1, 2 are piles, 3, 4 boxes, 5 to 8 the walls, then what is added.
VIEWS = [
    ((0.0, 0.0, 10.0), (0.0, 0.0, 0.0), {SEABED, 1, 3, 10, 11, 12}),
    ((0.0, 0.0, 9.0), (5.0, -30.0, 10.0), {SEABED, 10, 11}),
    ((3.0, 0.0, 7.0), (0.0, -90.0, 0.0), {SEABED, 10, 11, 12}),
    ((0.0, 0.0, 9.0), (-20.0, -15.0, -160.0), {SEABED, 2, 4}),
    ((0.0, 0.0, 6.0), (0.0, 60.0, 0.0), {9}),
    ((18.0, 12.0, 9.0), (0.0, -10.0, 30.0), {SEABED}),
    ((20.0, -17.0, 10.0), (170.0, 5.0, -130.0), {SEABED}),
]


@pytest.mark.parametrize(("place", "angles", "things"), VIEWS)
@pytest.mark.parametrize("holes", [False, True])
def test_opengl_draws_the_objects_that_rays_hit(
    context: Any, place: Any, angles: Any, things: set[int], holes: bool
) -> None:
    rays, drawn, _ = pair(relief(holes))
    assert agree(rays, drawn, place, angles) >= things


@pytest.mark.parametrize("seed", range(4))
def test_pictures_from_random_poses_agree(context: Any, seed: int) -> None:
    """The poses are random, with the edge of the grid and places without data among them."""
    random = np.random.default_rng(seed)
    rays, drawn, other = pair(relief(holes=True)._replace(walls=False))
    for _ in range(6):
        north, east, roll, pitch, yaw = (random.uniform(-1.0, 1.0, 5) * (40, 40, 180, 90, 180)).tolist()
        other.position = [north + 2.0, east + 1.0, 9.5]
        assert agree(rays, drawn, (north, east, random.uniform(1.0, 10.0)), (roll, pitch, yaw), 0.998)


def test_pictures_of_a_flat_seabed_and_by_a_wide_lens_agree(context: Any) -> None:
    world = relief()._replace(terrain=None, walls=False)
    rays, drawn, _ = pair(world)
    assert agree(rays, drawn, (0.0, 0.0, 10.0), (0.0, -20.0, 0.0)) >= {NOTHING, SEABED, 7}
    focal = 0.5 * WIDTH / tan(radians(85.0))
    pixels = pixel_rays(WIDTH, HEIGHT, Intrinsics(focal, focal, 0.5 * (WIDTH - 1), 0.5 * (HEIGHT - 1)), (0.0,) * 5)
    scenes = RayScene(relief()), opengl.PictureScene(relief(), WIDTH, HEIGHT, focal)
    one, other = (np.asarray(scene.hits((0.0, 0.0, 9.0), pixels, REACH).objects) for scene in scenes)
    assert (one == other).mean() > SHARE


def test_moved_and_added_objects_are_drawn(context: Any) -> None:
    rays, drawn, other = pair(relief())
    camera = (0.0, 0.0, 10.0)
    assert 11 in agree(rays, drawn, camera, (0.0, 0.0, 0.0))
    other.position = [2.0, -1.0, 10.2]
    other.quaternion = list(from_euler(1.0, 0.5, 0.2))
    assert 11 in agree(rays, drawn, camera, (0.0, 0.0, 0.0))
    other.position = [0.0, 0.0, 1e6]  # a neighbour that has sent nothing
    assert 11 not in agree(rays, drawn, camera, (0.0, 0.0, 0.0))
    for scene in (rays, drawn):
        scene.add(box((2.0, 0.0, 10.0), (0.3, 0.4, 0.5), matrix(from_euler(0.2, 0.5, 0.8))))
    assert 13 in agree(rays, drawn, camera, (0.0, 0.0, 0.0))


def test_distances_from_inside_an_object_are_zero(context: Any) -> None:
    rays, drawn, _ = pair(relief())
    for place in ((-8.0, 3.0, 11.0), (6.0, 2.0, 9.0), (0.0, 0.0, 17.0), (23.9, 30.0, 8.0), OTHER):
        for scene in (rays, drawn):
            assert not np.asarray(scene.hits(place, PIXELS, REACH).distances).any()


# --- the camera


def shot(renderer: Any, world: World, **keys: Any) -> CameraSample:
    model = CameraModel(width=WIDTH, height=HEIGHT, renderer=renderer, **keys)
    scene = Simulation(VEHICLE, world, {}, position=(0.0, 0.0, 5.0))
    camera = Camera(model, Mounting(orientation=(0.0, radians(-20.0), 0.0)), 1, scene)
    camera.add(hull(VEHICLE), State(OTHER))
    state = State((0.0, 0.0, 9.5))
    state.nu = [0.6, 0.2, -0.1, 0.1, -0.3, 0.5]
    return camera.sample(0, state)


def test_pictures_of_both_renderers_are_equal(context: Any) -> None:
    """The colours agree to a level or two; depths, labels, points and noise are equal."""
    true = [shot(renderer, relief(), ground_truth=True, points=True) for renderer in ("rays", "opengl")]
    labels = [np.frombuffer(sample.labels or b"", np.int32) for sample in true]
    assert (labels[0] == labels[1]).mean() > SHARE
    assert len(np.unique(labels[1])) > 4
    points = [np.frombuffer(sample.points or b"", np.float32) for sample in true]
    assert np.isclose(points[0], points[1], atol=ALIKE, equal_nan=True).mean() > SHARE
    for one, other in (true, [shot(renderer, relief(), lamps=1.0) for renderer in ("rays", "opengl")]):
        colours = [np.frombuffer(sample.rgb, np.uint8).astype(int) for sample in (one, other)]
        assert (np.abs(colours[0] - colours[1]) <= 2).mean() > SHARE
        assert colours[0].std() > 5.0
        depths = [np.frombuffer(sample.depth or b"", np.float32) for sample in (one, other)]
        assert np.isclose(depths[0], depths[1], rtol=CLOSE).mean() > SHARE


LENSES = [(-0.25, 0.06, 0.002, -0.001, 0.0), (0.15, 0.0, 0.0, 0.0, 0.0)]


@pytest.mark.parametrize("lens", LENSES)
def test_lens_distortion_is_equal_in_both_renderers(context: Any, lens: Any) -> None:
    """Outlines agree to half a pixel, and distances to 5 in 1000, as the nearest surface is taken as a plane."""
    keys = {"ground_truth": True, "distortion": lens}
    one, other = (shot(renderer, relief(), **keys) for renderer in ("rays", "opengl"))
    labels = [np.frombuffer(sample.labels or b"", np.int32) for sample in (one, other)]
    assert (labels[0] == labels[1]).mean() > LENS_SHARE
    assert len(np.unique(labels[1])) > 4
    depths = [np.frombuffer(sample.depth or b"", np.float32) for sample in (one, other)]
    some = (labels[0] == labels[1]) & np.isfinite(depths[0])
    assert np.isclose(depths[0][some], depths[1][some], rtol=5e-3).mean() > LENS_SHARE
    straight = np.frombuffer(shot("opengl", relief(), ground_truth=True).labels or b"", np.int32)
    assert (labels[1] != straight).mean() > 1.5 * (1.0 - LENS_SHARE), "it does distort"


EFFECTS: list[dict[str, Any]] = [
    {"lamps": 1.0, "lamp_offset": 0.4}, {"lamps": 1.0, "lamp_offset": 0.4, "lamp_shadows": True},
    {"lamps": 1.0, "lamp_offset": 0.4, "backscatter": 1.0}, {"snow": 500.0, "lamps": 1.0}, {"caustics": 1.0},
    {"exposure_time": 0.05}, {"readout_time": 0.05}, {"distortion": LENSES[0], "caustics": 0.5, "snow": 100.0},
]  # fmt: skip


@pytest.mark.parametrize("keys", EFFECTS, ids="-".join)
def test_light_effects_are_equal_in_both_renderers(context: Any, keys: dict[str, Any]) -> None:
    """Colours agree within two of 255 levels except at a few pixels in a hundred."""
    one, other, without = (
        np.frombuffer(shot(renderer, relief()._replace(bottom=Bottom()), exposure=2.0, **some).rgb, np.uint8).astype(
            int
        )
        for renderer, some in (("rays", keys), ("opengl", keys), ("rays", {}))
    )
    assert (np.abs(one - other) <= 2).mean() > LENS_SHARE
    assert (one != without).mean() > 0.02, "it changes the picture"


def test_rays_are_the_default_and_load_no_opengl() -> None:
    code = (
        "import sys; from tests.unit.sim.sensors.test_camera import camera, FLAT, POSE; camera(FLAT).sample(0, POSE)\n"
        "print(*({'moderngl', 'sim.rays.opengl'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert (done.stdout.strip(), done.returncode) == ("", 0), done.stderr


# --- what cannot be


def test_another_renderer_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"renderer.*vulkan"):
        parse({"renderer": "vulkan"}, CameraModel, "deep.toml: sensors.camera")
    assert parse({"renderer": "opengl"}, CameraModel, "deep.toml: sensors.camera").renderer == "opengl"


def test_a_lens_with_a_too_wide_view_is_refused(context: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opengl, "MAX_WIDER", 1)
    with pytest.raises(ConfigError, match="too far to the sides; take renderer"):
        shot("opengl", relief(), distortion=(-0.25, 0.06, 0.0, 0.0, 0.0))


@pytest.fixture
def unopened() -> Any:
    """Forget the open context before and after the test."""
    opengl.open_context.cache_clear()
    yield
    opengl.open_context.cache_clear()


def test_a_missing_moderngl_names_the_extra(unopened: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "moderngl", None)
    with pytest.raises(MissingExtraError, match=r"moderngl: pip install 'uuv-hil\[opengl\]'"):
        shot("opengl", relief())


def test_a_missing_opengl_driver_is_reported_with_the_remedy(unopened: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(**_: Any) -> None:
        raise Exception("eglInitialize failed (0x3001)")  # noqa: TRY002 - what it raises

    monkeypatch.setattr("moderngl.create_context", fail)
    with pytest.raises(ConfigError, match=r"eglInitialize failed.*apt install libegl1 libgl1 libgl1-mesa-dri.*rays"):
        shot("opengl", relief())


def test_a_terrain_larger_than_a_texture_is_refused(context: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    most = context.info["GL_MAX_TEXTURE_SIZE"]
    monkeypatch.setattr(opengl, "nodes", lambda *_: (np.arange(most + 1), np.arange(most + 1.0)))
    with pytest.raises(ConfigError, match=f"sees {most} nodes of a terrain at most: lower max_range"):
        shot("opengl", relief())


# --- the grid


def test_nodes_beyond_the_grid_repeat_its_edge() -> None:
    """There are 5 nodes every 2 m; the camera is at the second. Beyond the edge it is repeated, then one far away."""
    numbers, distances = opengl.nodes(1.0, 5, 2.0, -0.5, 3.0, 100.0)
    assert (numbers.tolist(), distances.tolist()) == ([0, 1, 2, 3], [-2.0, 0.0, 2.0, 4.0])
    numbers, distances = opengl.nodes(1.0, 5, 2.0, -9.0, 9.0, 100.0)
    assert numbers.tolist() == [-2, -1, 0, 1, 2, 3, 4, 5, 6]
    assert distances.tolist() == [-100.0, -2.0, -2.0, 0.0, 2.0, 4.0, 6.0, 6.0, 100.0]
    for beside in (-60.0, 70.0):
        numbers, distances = opengl.nodes(beside, 5, 2.0, -20.0, 20.0, 40.0)
        assert distances[0] <= -20.0
        assert distances[-1] >= 20.0
        assert not ((numbers >= 0) & (numbers < 4)).any()


def test_only_the_border_of_unknown_ground_is_drawn() -> None:
    unknown = np.zeros((9, 9), bool)
    unknown[2:7, 2:7] = True  # 6 x 6 cells, 20 of them on the rim
    boxes = opengl.columns_without_data(unknown, np.arange(9.0), np.arange(9.0), 60.0)
    assert len(boxes) == 20
    assert (boxes[:, KIND] == BOX).all()
