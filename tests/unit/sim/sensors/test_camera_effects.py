"""Effects of lamps, particles, waves and motion on the camera's picture: seeded, and of the right size."""

from math import exp, nan, pi, radians, tan
from typing import Any

import numpy as np
import pytest

from sim.dynamics import State
from sim.environment.bottom import Bottom
from sim.environment.obstacles import Box, Cylinder
from sim.environment.optics import jerlov
from sim.environment.relief import Fractal
from sim.environment.terrain import Terrain, covering
from sim.environment.world import World
from sim.rays.scene import RayScene
from sim.rotations import from_euler
from sim.rotations import integrate as turn
from sim.sensors.imaging.camera.image_sensor import ImageSensor, normal_noise
from sim.sensors.imaging.camera.lamps import _BACKWARD_SHARE, Lamps
from sim.sensors.imaging.camera.model import CameraModel
from sim.sensors.imaging.camera.particles import MarineSnow
from sim.sensors.imaging.camera.sensor import Camera
from sim.sensors.imaging.samples import CameraSample
from sim.sensors.mounting import Mounting
from sim.twins import load_picture
from tests.support.fitted import EXTENT, scene
from tests.support.lazy import import_lazily

integrate = import_lazily("scipy.integrate")

PILED = World("piled", "test", EXTENT, 60.0, cylinder=(Cylinder(3.0, 0.0, 0.2, top=50.0),),
              box=(Box(6.0, 0.0, 0.5, 20.0, 0.0, top=50.0),))  # fmt: skip
SHALLOW = World("shallow", "test", EXTENT, 3.0)
POSE = State((0.0, 0.0, 58.0))
KEYS = CameraModel(width=80, height=60, read_noise=0.0, full_well=1e7, depth_noise=0.0, vignetting=0.0, exposure=1.0)
DOWN = Mounting(orientation=(0.0, radians(-90.0), 0.0))


def take_picture(
    world: World = PILED, state: State = POSE, mounting: Mounting = Mounting(), seed: int = 1, time_ns: int = 0,
    **keys: Any,
) -> CameraSample:  # fmt: skip
    return Camera(KEYS._replace(**keys), mounting, seed, scene(world, 2.0)).sample(time_ns, state)


def colours(sample: CameraSample) -> Any:
    return np.frombuffer(sample.rgb, np.uint8).reshape(sample.height, sample.width, 3).astype(int)


LAMPS: dict[str, Any] = {"lamps": 1.0, "lamp_offset": 0.4}


def test_lamps_beside_the_camera_cast_shadows() -> None:
    """Each lamp has a shadow of a pile on the wall 3 m behind it, and none is straight behind."""
    keys = LAMPS | {"lamps": 300.0, "water": "clear", "exposure": 0.1}
    free, shaded = (colours(take_picture(lamp_shadows=on, **keys)).sum(axis=2) for on in (False, True))
    row = 30
    darker = np.flatnonzero(shaded[row] < 0.8 * free[row])
    assert (shaded <= free + 1).all()
    # The shadow of the lamp at port lies where the line by the pile's middle meets the wall: 2 * 0.4 m of the wall.
    scale = 0.5 * 80 / tan(radians(40.0)) / 5.75
    middle = 39.5
    for side in (-1, 1):
        place = middle + side * (0.4 / 3.0 * (5.75 - 3.0)) * scale
        assert np.abs(darker - place).min() < 1.0
    assert len(darker)


def test_shadows_and_backscatter_need_lamps_beside_the_camera() -> None:
    assert "lamp_shadows needs lamps and a lamp_offset" in str(KEYS._replace(lamp_shadows=True).validate())
    assert "backscatter needs lamps" in str(KEYS._replace(backscatter=1.0, lamps=1.0).validate())
    assert KEYS._replace(backscatter=1.0, **LAMPS).validate() is None


@pytest.mark.parametrize("water", ["II", "7C"])
@pytest.mark.parametrize("distance", [1.0, 4.0, 25.0])
def test_backscatter_is_the_integral_of_single_scattering(water: str, distance: float) -> None:
    kind = jerlov(water, 30.0)
    lamps = Lamps(0.4, 2.0, False, 1.0, 30.0)
    veil = lamps.veil(np.array([distance], np.float32), np.zeros(1, np.float32), kind)[0]
    for channel in range(3):
        c, b = kind.attenuation[channel], kind.scattering[channel]

        def recorded_picture(distance: float, c: float = c, b: float = b) -> float:
            squared = distance * distance + 0.16
            return pi * 2.0 * exp(-c * (distance + squared**0.5)) / squared * b * _BACKWARD_SHARE

        expected = integrate.quad(recorded_picture, 0.4, distance)[0]
        assert veil[channel] == pytest.approx(expected, rel=0.03)


def test_marine_snow_is_fixed_in_the_water_and_seeded() -> None:
    snow = MarineSnow(400.0, (80, 60), 40.0, 5)
    points, _ = snow._particles(np.array([0.0, 0.0, 10.0]))
    there, _ = snow._particles(np.array([0.4, -0.3, 10.2]))
    both = {tuple(row) for row in points.round(6).tolist()} & {tuple(row) for row in there.round(6).tolist()}
    assert len(both) > 0.5 * len(points)
    volume = 4.0 / 3.0 * pi * 2.5**3
    within = (np.linalg.norm(points - (0.0, 0.0, 10.0), axis=1) < 2.5).sum()
    assert within == pytest.approx(400.0 * volume, rel=0.1)
    pictures = [take_picture(snow=400.0, lamps=1.0, seed=seed).rgb for seed in (1, 1, 2)]
    assert pictures[0] == pictures[1] != pictures[2]
    assert pictures[0] != take_picture(lamps=1.0).rgb


def test_marine_snow_behind_objects_is_hidden() -> None:
    snow = MarineSnow(2000.0, (80, 60), 40.0, 5)
    dark = np.zeros((4800, 3), np.float32)
    kind = jerlov("II", 5.0)
    near, far = (
        snow.add_particles(dark, np.full(4800, reach), np.zeros(3), np.eye(3), kind, (1.0, 0.0)).sum()
        for reach in (0.5, 30.0)
    )
    assert 0.0 < near < 0.8 * far


def moving(nu: tuple[float, ...]) -> State:
    state = State((0.0, 0.0, 1.5))
    state.nu = list(nu)
    return state


def test_a_camera_at_rest_has_no_blur() -> None:
    still = take_picture(SHALLOW, moving((0.0,) * 6), DOWN, exposure_time=0.1, readout_time=0.1)
    assert still.rgb == take_picture(SHALLOW, moving((0.0,) * 6), DOWN).rgb


def test_blur_is_along_the_motion() -> None:
    """The blur over a level seabed, seen straight down, is along the rows' direction: up in the picture for surge."""
    sharp, blurred = (
        colours(take_picture(SHALLOW, moving((1.0, 0, 0, 0, 0, 0)), DOWN, exposure_time=t, water="clear")).mean(axis=2)
        for t in (0.0, 0.2)
    )
    along, across = (
        np.abs(np.diff(blurred, axis=axis)).mean() / np.abs(np.diff(sharp, axis=axis)).mean() for axis in (0, 1)
    )
    assert along < 0.5 * across
    assert blurred.mean() == pytest.approx(sharp.mean(), rel=0.05)


def test_a_rolling_shutter_captures_each_row_at_its_own_time() -> None:
    """A row of a turning camera equals that of a camera that captures all rows at the row's time."""
    rate, readout = 0.8, 0.1
    state = State(POSE.position, from_euler(0.0, 0.0, 0.0))
    state.nu = [0.0, 0.0, 0.0, 0.0, 0.0, rate]
    rolled = colours(take_picture(state=state, readout_time=readout, water="clear")).sum(axis=2)
    sharp = colours(take_picture(water="clear")).sum(axis=2)
    for row in (2, 57):
        late = ((row + 0.5) / 60 - 0.5) * readout
        then = State(POSE.position, turn((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, rate), late))
        then.nu = [0.0] * 6
        true = colours(take_picture(state=then, water="clear")).sum(axis=2)
        inner = slice(5, 75)
        error = np.abs(rolled[row, inner] - true[row, inner]).mean()
        assert error < 0.7 * np.abs(sharp[row, inner] - true[row, inner]).mean()


def test_bottom_ripples_are_visible_across_their_heading(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ripples of the world's [bottom] are stripes across their heading."""
    rippled = SHALLOW._replace(bottom=Bottom("sand", roughness=0.0, patches=0.0, ripple_height=0.06, ripple_length=0.5))
    monkeypatch.setattr("sim.sensors.imaging.scenery.SCALES", ((0.01, 0.0), (0.089, 0.0)))
    picture = colours(take_picture(rippled, State((0.0, 0.0, 0.5)), DOWN, water="clear")).mean(axis=2)
    assert picture.std(axis=0).mean() > 5.0 * picture.std(axis=1).mean()
    flat = colours(take_picture(SHALLOW, State((0.0, 0.0, 0.5)), DOWN, water="clear")).mean(axis=2)
    assert flat.std() < 0.2 * picture.std()


def test_ground_truth_pictures_have_no_effects() -> None:
    settings: dict[str, Any] = {
        "snow": 500.0,
        "exposure_time": 0.1,
        "readout_time": 0.1,
        "backscatter": 1.0,
    }
    truth = take_picture(ground_truth=True, **LAMPS)
    assert take_picture(ground_truth=True, **settings, **LAMPS).rgb == truth.rgb


@pytest.mark.parametrize("kind", ["mud", "rock"])
@pytest.mark.parametrize("keys", [{}, {"lamps": 3.0, "water": "3C"}, {"water": "clear"}, {"ground_truth": True}])
def test_the_compiled_pass_gives_the_same_light(
    kind: Any, keys: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The compiled pass agrees with Python to a thousandth.

    The scene is relief with ripples, a place without data, a pile, the surface, and nothing.
    """
    if load_picture() is None:
        pytest.skip("no C compiler here")
    grid = covering((-20.0, 20.0, -20.0, 20.0), 0.7)
    depths = Fractal(9.0, 1.0, 0.9, seed=3).depths(grid)
    depths[200] = nan
    world = PILED._replace(
        depth=9.0, terrain=Terrain(grid, depths, 9.0), cylinder=(Cylinder(4.0, 1.0, 0.3, top=2.0),),
        bottom=Bottom(kind, ripple_height=0.05, ripple_length=0.5, ripple_heading=0.7),
    )  # fmt: skip
    for angles in ((0.0, -0.6, 0.2), (0.1, 0.5, 1.0), (0.0, -1.5, 2.0)):
        renderer = Camera(KEYS._replace(**keys), Mounting(orientation=angles), 1, scene(world, 2.0))._renderer
        state = State((0.3, -0.2, 5.0))
        assert renderer._shading
        at_once, ranges, objects = renderer.render(0, state)
        monkeypatch.setattr(renderer, "_shading", None)
        expected, *surfaces = renderer.render(0, state)
        assert np.isclose(at_once, expected, rtol=2e-3, atol=1e-4).mean() > 0.999
        assert np.array_equal(ranges, surfaces[0])
        assert np.array_equal(objects, surfaces[1])
        assert expected.std() > 0.01


def test_the_compiled_pass_refuses_mismatched_buffers() -> None:
    compiled = load_picture()
    if compiled is None:
        pytest.skip("no C compiler here")
    empty = np.zeros(0, np.float32)
    grain, decays, settings = np.zeros(513 * 513, np.float32), np.zeros(1025 * 6, np.float32), [1.0] * 42
    geometry = RayScene(PILED, "C").compiled((0.0, 0.0, 0.0), 5.0)
    with pytest.raises(ValueError, match="numbers are needed"):
        compiled.picture(geometry, [0.0], *[empty] * 9)
    with pytest.raises(ValueError, match="a buffer of the surfaces' appearance has a wrong size"):
        compiled.picture(geometry, settings, *[empty] * 9)
    colours, single, objects = np.zeros(3, np.float32), np.zeros(1, np.float32), np.zeros(1, np.int32)
    appearance = colours, grain, decays, empty, empty
    vectors = np.zeros(3, np.float32)
    with pytest.raises(ValueError, match="or an object no colour"):
        compiled.picture(geometry, settings, *appearance, np.zeros(3), vectors, np.zeros(1), objects)
    with pytest.raises(ValueError, match="PyCapsule"):
        compiled.picture(print, settings, *appearance, np.zeros(3), vectors, np.zeros(1), objects)
    with pytest.raises(ValueError, match="a buffer has not the size of 1 pixels"):
        compiled.develop(1, (1.0,) * 5, empty, single, *[empty] * 6)


def test_the_compiled_sensor_gives_the_same_picture() -> None:
    """The sensors agree with noise, falloff and exposure to a level of 256, where numbers lie between two; so do
    depths.
    """
    if load_picture() is None:
        pytest.skip("no C compiler here")
    chance = np.random.default_rng(1)
    light = chance.uniform(0.0, 1.5, (4800, 3)).astype(np.float32)
    ranges = chance.uniform(0.1, 40.0, 4800)
    ranges[7] = np.inf
    pictures, depths = [], []
    for compiled in (True, False):
        one = ImageSensor(CameraModel(width=80, height=60), np.linspace(0.7, 1.0, 4800, dtype=np.float32), 1, "camera")
        assert one._develop
        one._develop = one._develop if compiled else None
        rgb, depth = one.develop(light, ranges)
        pictures.append(np.frombuffer(rgb, np.uint8).astype(int))
        depths.append(np.frombuffer(depth, np.float32))
    assert np.abs(pictures[0] - pictures[1]).max() <= 1
    assert (pictures[0] == pictures[1]).mean() > 0.999
    np.testing.assert_allclose(depths[0], depths[1], rtol=1e-6)


def test_noise_is_normal_and_uncorrelated() -> None:
    """Four rows have normal moments and tails, and are correlated neither with neighbours nor with other pictures."""
    noise = normal_noise(12, 300_000)
    for row in noise:
        assert abs(row.mean()) < 0.01
        assert row.std() == pytest.approx(1.0, abs=0.01)
        assert abs((row**3).mean()) < 0.03
        assert (row**4).mean() == pytest.approx(3.0, abs=0.06)
        assert (np.abs(row) > 2.0).mean() == pytest.approx(0.0455, abs=0.002)
        for shift in (1, 2, 640, 4096):
            assert abs(np.corrcoef(row[shift:], row[:-shift])[0, 1]) < 0.01
    both = np.vstack([noise, normal_noise(13, 300_000)])
    assert np.abs(np.corrcoef(both) - np.eye(8)).max() < 0.01
