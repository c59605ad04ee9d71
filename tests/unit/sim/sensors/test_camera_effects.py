"""Effects of lamps, particles, waves and motion on the camera's picture: seeded, and of the right size."""

from math import hypot, inf, nan, pi, radians, tan
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
from sim.rotations import from_euler, matrix, rotate_inverse
from sim.sensors.imaging.camera.image_sensor import ImageSensor, normal_noise
from sim.sensors.imaging.camera.lamps import _BACKWARD_SHARE, Lamps
from sim.sensors.imaging.camera.model import CameraModel
from sim.sensors.imaging.camera.motion import Motion, RawPicture
from sim.sensors.imaging.camera.particles import MarineSnow
from sim.sensors.imaging.camera.sensor import Camera
from sim.sensors.imaging.samples import CameraSample
from sim.sensors.mounting import Mounting
from sim.twins import load_picture
from tests.support.fitted import EXTENT, scene

PILED = World("piled", "test", EXTENT, 60.0, cylinder=(Cylinder(3.0, 0.0, 0.2, top=50.0),),
              box=(Box(6.0, 0.0, 0.5, 20.0, 0.0, top=50.0),))  # fmt: skip
SHALLOW = World("shallow", "test", EXTENT, 3.0)
POSE = State((0.0, 0.0, 58.0))
KEYS = CameraModel(width=80, height=60, read_noise=0.0, full_well=1e7, depth_noise=0.0, vignetting=0.0, exposure=1.0)
DOWN = Mounting(orientation=(0.0, radians(-90.0), 0.0))


def take_picture(
    world: World = PILED, state: State = POSE, mounting: Mounting = Mounting(), seed: int = 1, time_ns: int = 0,
    **keys: Any
) -> CameraSample:  # fmt: skip
    return Camera(KEYS._replace(**keys), mounting, seed, scene(world, 2.0)).sample(time_ns, state)


def colours(sample: CameraSample) -> Any:
    return np.frombuffer(sample.rgb, np.uint8).reshape(sample.height, sample.width, 3).astype(int)


LAMPS: dict[str, Any] = {"lamps": 1.0, "lamp_offset": 0.4}


def test_lamps_beside_the_camera_cast_shadows() -> None:
    """Each lamp has a shadow of a pile on the wall 3 m behind it, and none is straight behind."""
    keys = LAMPS | {"lamps": 300.0, "water": "clear", "exposure": 0.1}
    free, shaded = (colours(take_picture(lamp_shadows=on, **keys)).sum(axis=2) for on in (False, True))
    darker = np.flatnonzero(shaded[30] < 0.8 * free[30])
    assert (shaded <= free + 1).all()
    assert (shaded == free).mean() > 0.5, "what no pile hides from a lamp is lit"
    # The shadow of the lamp at port lies where the line by the pile's middle meets the wall: 2 * 0.4 m of the wall.
    place = 0.4 / 3.0 * (5.75 - 3.0) * 0.5 * 80 / tan(radians(40.0)) / 5.75
    assert max(np.abs(darker - 39.5 - side * place).min() for side in (-1, 1)) < 1.0


def test_shadows_and_backscatter_need_lamps_beside_the_camera() -> None:
    assert "lamp_shadows needs lamps and a lamp_offset" in str(KEYS._replace(lamp_shadows=True).validate())
    assert "backscatter needs lamps" in str(KEYS._replace(backscatter=1.0, lamps=1.0).validate())
    assert KEYS._replace(backscatter=1.0, **LAMPS).validate() is None


@pytest.mark.parametrize(("water", "sideways"), [("II", 0.0), ("7C", 0.33), ("II", -0.71)])
@pytest.mark.parametrize("distance", [0.6, 4.0, inf])
def test_backscatter_is_the_integral_of_single_scattering(water: str, sideways: float, distance: float) -> None:
    """Each lamp lights the part of a ray inside its beam, 45 deg to each side, up to the reach of 30 m."""
    kind, path = jerlov(water, 30.0), np.linspace(1e-3, min(distance, 30.0), 100_001)
    far, aside = np.array([distance], np.float32), np.array([sideways], np.float32)
    veil = Lamps(0.4, 2.0, False, 0.7, 30.0).veil(far, aside, kind)[0]
    for c, b, found in zip(kind.attenuation, kind.scattering, veil, strict=True):
        expected = 0.0
        for offset in (-0.4, 0.4):
            to_side, squared = path * sideways - offset, path * path - 2.0 * path * offset * sideways + 0.16
            lit = np.abs(to_side) <= path * np.sqrt(1.0 - sideways**2)
            sent = pi * np.exp(-c * (path + np.sqrt(squared))) / squared
            expected += float(np.trapezoid(lit * sent * b * 0.7 * _BACKWARD_SHARE, path))
        assert found == pytest.approx(expected, rel=0.02)


def test_marine_snow_is_fixed_in_the_water_and_seeded() -> None:
    snow, places = MarineSnow(400.0, (80, 60), 40.0, 5), np.array([[0.0, 0.0, 10.0], [0.4, -0.3, 10.2]])
    found = [snow._particles(place)[0] for place in places]
    within = [np.linalg.norm(points[:, None] - places, axis=2).max(axis=1) < 2.5 for points in found]
    here, there = (np.unique(points[near], axis=0) for points, near in zip(found, within, strict=True))
    assert np.array_equal(here, there)
    assert len(here) > 10_000
    for density in (400.0, 4.0):
        points, radii = MarineSnow(density, (80, 60), 40.0, 5)._particles(np.array([0.1, 0.2, 10.3]))
        near = np.linalg.norm(points - (0.1, 0.2, 10.3), axis=1) < 2.5
        assert near.sum() == pytest.approx(density * 4.0 / 3.0 * pi * 2.5**3, rel=0.1)
        assert np.quantile(radii, [0.0, 0.5, 1.0]) == pytest.approx([4e-4, 4e-4 * 7.5**0.125, 3e-3], rel=0.1)
    pictures = [take_picture(snow=400.0, lamps=1.0, seed=seed).rgb for seed in (1, 1, 2)]
    assert pictures[0] == pictures[1] != pictures[2]
    assert pictures[0] != take_picture(lamps=1.0).rgb


@pytest.mark.parametrize("ahead", [0.4, 0.7])
def test_a_particle_covers_its_disc_where_it_is_seen(ahead: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A blurred particle spreads the light of its disc, and hides as much of what is behind it. A quarter of two is in
    the corners of the picture; two more are astern and too far away.
    """
    snow, axes = MarineSnow(1.0, (81, 60), 200.0, 5), np.array(matrix(from_euler(0.2, -0.5, 2.0))).reshape(3, 3)
    place, sharp, kind = np.array([4.0, -7.0, 9.0]), 0.003 * 200.0 / ahead, jerlov("II", 5.0)
    seen = ahead * np.array([[1.0, 0.05, -0.1], [1.0, -0.2025, -0.15], [1.0, 0.2025, 0.15], [-1.0, 0.1, 0.1]])
    points = np.vstack([seen, [2.52, 0.1, 0.1]]) @ axes.T + place
    monkeypatch.setattr(snow, "_particles", lambda position: (points, np.full(5, 0.003)))
    distances, parts = np.linalg.norm(seen[:3], axis=1), np.array([1.0, 0.25, 0.25]) * pi * sharp**2

    def take(behind: float, reach: float = inf) -> Any:
        light, ranges = np.full((4860, 3), behind, np.float32), np.full(4860, reach)
        return snow.add_particles(light, ranges, place, axes, kind, (2.0, 0.3)).reshape(60, 81, 3)

    alone, blur = take(0.0), hypot(sharp, 0.002 * (1.0 / ahead - 1.0) * 200.0)
    for channel, c in enumerate(kind.attenuation):
        lit = np.hypot(distances, 0.3)
        shine = 0.5 * (0.5 * kind.light[channel] + 2.0 * np.exp(-c * lit) / lit**2) * np.exp(-c * distances)
        pieces = [alone[:20, 40:60, channel], alone[:8, :8, channel], alone[-8:, -8:, channel]]
        assert [piece.sum() for piece in pieces] == pytest.approx(shine * parts, rel=0.05)
        assert alone[..., channel].sum() == pytest.approx(sum(map(np.sum, pieces)))
        across, down = pieces[0].sum(axis=0) / pieces[0].sum(), pieces[0].sum(axis=1) / pieces[0].sum()
        assert (across @ np.arange(20), down @ np.arange(20)) == pytest.approx((10.0, 9.5), abs=0.05)
        assert across @ (np.arange(20) - 10.0) ** 2 == pytest.approx(0.5 * blur**2, rel=0.1)
    assert (1.0 - (take(1.0) - alone)).sum() == pytest.approx(3.0 * parts.sum(), rel=0.05)
    assert (take(0.0, distances.max() + 0.01) == alone).all()
    assert not take(0.0, distances.min() - 0.01).any(), "they are behind a surface"


def test_only_a_moving_camera_with_a_slow_shutter_blurs() -> None:
    def take(surge: float, **shutter: Any) -> bytes:
        return take_picture(SHALLOW, State((0.0, 0.0, 1.5), nu=(surge, 0.0, 0.0, 0.0, 0.0, 0.0)), DOWN, **shutter).rgb

    assert take(0.0, exposure_time=0.1, readout_time=0.1) == take(0.0) == take(1.0)
    assert take(1.0, exposure_time=0.1) != take(1.0) != take(1.0, readout_time=0.1)


def test_the_flow_is_the_motion_of_projected_points() -> None:
    """Points at rest are projected before and after a short motion of a camera off the origin, askew."""
    mounting, nu, dt = Mounting((0.3, -0.2, 0.1), (0.2, -0.4, 2.0)), (0.4, -0.3, 0.2, 0.1, -0.25, 0.3), 1e-4
    ahead, right, down = points = np.array([[2.0, 3.0, 5.0, 0.06], [0.7, -0.8, 1.5, 0.01], [-0.6, 0.9, 0.4, 0.02]])
    ranges = np.linalg.norm(points, axis=0)
    flow = Motion((4, 1), 50.0, (points / ranges).T.astype(np.float32), 0.0, 0.0).flow(mounting, nu, ranges)
    velocity, turning = (rotate_inverse(mounting.quaternion, v) for v in (mounting.velocity(nu), nu[3:]))
    after = points.T - dt * (np.array(velocity) + np.cross(turning, points.T))
    for found, before, then in zip(flow, (right, down), after.T[1:], strict=True):
        assert found == pytest.approx(50.0 * (then / after[:, 0] - before / ahead) / dt, rel=2e-3)


@pytest.mark.parametrize("axis", [1, 2])
def test_pixels_shift_by_the_flow_in_the_exposure_and_at_their_rows_times(axis: int) -> None:
    """Before a camera that moves to starboard, or down, by 20 pixels/s a wall shifts by as many the other way."""
    across = np.stack([np.ones((41, 41)), *np.meshgrid(*[(np.arange(41) - 20.0) / 40.0] * 2)], axis=-1).reshape(-1, 3)
    slant = np.linalg.norm(across, axis=1)
    line, nu = np.random.default_rng(1).random(41, np.float32), [0.0] * axis + [1.0] + [0.0] * (5 - axis)
    wall = np.tile(line, (41, 1)) if axis == 1 else np.tile(line[:, None], (1, 41))
    raw = RawPicture(np.repeat(wall.reshape(-1, 1), 3, axis=1), 2.0 * slant, np.zeros(1681, np.int32))
    toward = (across / slant[:, None]).astype(np.float32)
    blurred, skewed = (
        Motion((41, 41), 40.0, toward, *times).apply(raw, Mounting(), nu).radiance[:, 0].reshape(41, 41)
        for times in ((0.52, 0.0), (0.0, 2.05))
    )
    expected = np.convolve(np.pad(line, 5, mode="edge"), np.full(11, 1.0 / 11.0), "valid")
    rows, columns = np.mgrid[:41, :41]
    assert (blurred if axis == 1 else blurred.T) == pytest.approx(np.tile(expected, (41, 1)), rel=1e-5)
    assert (skewed == line[np.clip((columns if axis == 1 else rows) + rows - 20, 0, 40)]).all()


def test_bottom_ripples_are_visible_across_their_heading(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ripples of the world's [bottom] are stripes across their heading."""
    rippled = SHALLOW._replace(bottom=Bottom("sand", roughness=0.0, patches=0.0, ripple_height=0.06, ripple_length=0.5))
    monkeypatch.setattr("sim.sensors.imaging.scenery.SCALES", ((0.01, 0.0), (0.089, 0.0)))
    picture = colours(take_picture(rippled, State((0.0, 0.0, 0.5)), DOWN, water="clear")).mean(axis=2)
    assert picture.std(axis=0).mean() > 5.0 * picture.std(axis=1).mean()
    flat = colours(take_picture(SHALLOW, State((0.0, 0.0, 0.5)), DOWN, water="clear")).mean(axis=2)
    assert flat.std() < 0.2 * picture.std()


def test_ground_truth_pictures_have_no_effects() -> None:
    settings: dict[str, Any] = {"snow": 500.0, "exposure_time": 0.1, "readout_time": 0.1, "backscatter": 1.0}
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
