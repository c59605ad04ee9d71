"""The camera against planes, steps, spheres and cylinders worked out by hand."""

from math import cos, hypot, radians, sqrt, tan
from typing import Any

import numpy as np
import pytest

from sim.dynamics import State
from sim.environment.obstacles import Box, Cylinder
from sim.environment.ocean import Ocean, Waves
from sim.environment.optics import decode, jerlov, underwater
from sim.environment.relief import Fractal
from sim.environment.terrain import Terrain, covering
from sim.environment.world import World
from sim.rays.scene import SEABED
from sim.rotations import from_euler
from sim.sensors.imaging import scenery
from sim.sensors.imaging.camera.image_sensor import automatic_exposure
from sim.sensors.imaging.camera.model import CameraModel
from sim.sensors.imaging.camera.picture import distort, pixel_rays, undistort
from sim.sensors.imaging.camera.sensor import Camera
from sim.sensors.imaging.samples import CameraSample, Intrinsics
from sim.sensors.mounting import Mounting
from sim.sensors.surface import submersion
from tests.support.fitted import DEEP, EXTENT, scene

FLAT = World("flat", "test", EXTENT, 12.0)
TRUE = CameraModel(ground_truth=True, width=81, height=61)
POSE = State((0.0, 0.0, 8.0))
DOWN = Mounting(orientation=(0.0, radians(-90.0), 0.0))


def camera(world: World, model: CameraModel = TRUE, mounting: Mounting = Mounting(), seed: int = 1) -> Camera:
    return Camera(model, mounting, seed, scene(world))


def depths(sample: CameraSample) -> Any:
    assert sample.depth is not None
    return np.frombuffer(sample.depth, np.float32).reshape(sample.height, sample.width)


def labels(sample: CameraSample) -> Any:
    assert sample.labels is not None
    return np.frombuffer(sample.labels, np.int32).reshape(sample.height, sample.width)


def colours(sample: CameraSample) -> Any:
    return np.frombuffer(sample.rgb, np.uint8).reshape(sample.height, sample.width, 3)


def tangents(sample: CameraSample) -> tuple[Any, Any]:
    """Return the tangents to the right and down, of each column and row."""
    fx, fy, cx, cy = sample.intrinsics
    return (np.arange(sample.width) - cx) / fx, ((np.arange(sample.height) - cy) / fy)[:, None]


# --- geometry


def test_a_plane_across_the_axis_has_constant_depth() -> None:
    sample = camera(FLAT, mounting=DOWN).sample(5, POSE)
    assert (sample.time_ns, sample.width, sample.height) == (5, 81, 61)
    assert depths(sample) == pytest.approx(np.full((61, 81), 4.0), abs=1e-6)
    assert (labels(sample) == SEABED).all()


def test_right_in_the_picture_is_starboard_and_below_is_down() -> None:
    world = FLAT._replace(cylinder=(Cylinder(8.0, 3.0, 0.5, top=6.0),))
    sample = camera(world).sample(0, POSE)
    rows, columns = np.nonzero(labels(sample) == 1)
    assert columns.min() > 40
    assert columns.mean() == pytest.approx(sample.intrinsics.cx + sample.intrinsics.fx * 3.0 / 8.0, abs=1.0)
    assert rows.min() == pytest.approx(sample.intrinsics.cy - sample.intrinsics.fy * 2.0 / 7.7, abs=1.5)
    assert (labels(sample)[-1, :30] == SEABED).all()
    turned = camera(world).sample(0, State((0.0, 0.0, 8.0), from_euler(radians(90.0), 0.0, 0.0)))
    rows, columns = np.nonzero(labels(turned) == 1)  # rolled to starboard: what was right is above
    assert rows.max() < 30


def test_the_field_of_view_is_that_of_the_key() -> None:
    sample = camera(DEEP, TRUE._replace(field_of_view=radians(90.0), width=100)).sample(0, POSE)
    assert sample.intrinsics == pytest.approx((50.0, 50.0, 49.5, 30.0))
    assert sample.distortion == (0.0,) * 5


def test_a_distorting_lens_maps_pixels_to_its_rays() -> None:
    """A pixel looks where the lens maps it; a plane is then still a plane."""
    lens = (-0.2, 0.03, 0.001, -0.0005, -0.001)
    x, y = np.meshgrid(np.linspace(-0.8, 0.8, 33), np.linspace(-0.6, 0.6, 25))
    u, v = undistort(x, y, lens)
    assert np.hypot(u - x, v - y).max() > 0.05
    a, b = distort(u, v, lens)
    assert np.hypot(a - x, b - y).max() < 1e-9
    rays = pixel_rays(3, 1, Intrinsics(2.0, 2.0, 1.0, 0.0), lens)
    assert np.linalg.norm(rays, axis=1) == pytest.approx([1.0] * 3)
    assert rays[2, 1] / rays[2, 0] > 0.5  # barrel distortion: the view is wider than a pinhole's
    sample = camera(FLAT, TRUE._replace(distortion=lens), DOWN).sample(0, POSE)
    assert depths(sample) == pytest.approx(np.full((61, 81), 4.0), abs=1e-6)
    assert sample.distortion == lens


def test_k1_distorts_as_worked_out_by_hand() -> None:
    assert distort(np.array(0.3), np.array(-0.4), (0.2, 0.0, 0.0, 0.0, 0.0)) == pytest.approx((0.315, -0.42))
    found = distort(np.array(0.3), np.array(-0.4), (0.0, 0.0, 0.1, 0.01, 0.0))  # OpenCV's tangential terms
    assert found == pytest.approx((0.3 - 0.024 + 0.01 * (0.25 + 0.18), -0.4 + 0.1 * (0.25 + 0.32) - 0.0024))


def test_depths_are_infinite_beyond_reach_and_in_air() -> None:
    assert np.isinf(depths(camera(FLAT, TRUE._replace(max_range=3.0), DOWN).sample(0, POSE))).all()
    sample = camera(FLAT).sample(0, State((0.0, 0.0, -0.5)))
    assert np.isinf(depths(sample)).all()
    assert not colours(sample).any()
    wavy = FLAT._replace(ocean=Ocean(waves=Waves(2.0, 6.0, components=3)))
    trough = next(t for t in range(0, 10**10, 10**8) if submersion(scene(wavy), t, (0.0, 0.0, 0.3)) < 0.0)
    assert not colours(camera(wavy).sample(trough, State((0.0, 0.0, 0.3)))).any()


# --- light

RAW = TRUE._replace(ground_truth=False, vignetting=0.0, read_noise=0.0, full_well=1e7, exposure=1.0, depth_noise=0.0)


def test_the_picture_follows_the_underwater_image_model() -> None:
    """The picture is that of radiances without water, in the light that is left, through
    sim.environment.optics.underwater, but for the surface, which mirrors the water.
    """
    grid = covering(EXTENT, 1.0)
    world = FLAT._replace(
        terrain=Terrain(grid, Fractal(12.0, 0.6, seed=2).depths(grid), 12.0), box=(Box(6.0, 1.0, 1.0, 1.0, top=7.0),)
    )
    dry, wet = camera(world, RAW._replace(water="clear")), camera(world, RAW._replace(water="1C"))
    scene, ranges, objects = dry._renderer.render(0, POSE)
    picture, _, _ = wet._renderer.render(0, POSE)
    water, below = jerlov("1C", 8.0), objects != wet._renderer._surface
    expected = underwater(scene * np.array(water.light, np.float32), ranges, water)
    assert picture[below] == pytest.approx(expected[below], abs=1e-6)
    assert np.abs(picture - scene).mean() > 0.05


@pytest.mark.parametrize(("offset", "shadows"), [(0.0, False), (0.3, True)])
@pytest.mark.parametrize("distance", [1.0, 3.0])
def test_lamp_light_falls_with_the_square_of_the_distance(distance: float, offset: float, shadows: bool) -> None:
    """A wall in the dark in clear water gets the light of a lamp, or of two beside the camera, by its cosine."""
    world = DEEP._replace(walls=True, extent=(-50.0, distance, -500.0, 500.0))
    keys = RAW._replace(water="clear", max_range=5.0, lamp_offset=offset, lamp_shadows=shadows)
    lit, unlit = (camera(world, keys._replace(lamps=on))._renderer.render(0, POSE)[0] for on in (2.0, 0.0))
    tone, on_wall = unlit / 0.6, unlit[:, 0] > 0.0  # of a wall in full daylight
    rays = pixel_rays(81, 61, camera(world)._intrinsics, (0.0,) * 5)
    _, across, down = (rays / rays[:, :1] * distance).T
    expected = sum(distance / np.hypot(np.hypot(across - side, down), distance) ** 3 for side in (-offset, offset))
    share = (lit - unlit)[on_wall] / tone[on_wall]
    assert share == pytest.approx(np.repeat(expected[on_wall, None], 3, axis=1), rel=3e-4)


def test_fixed_exposure_scales_and_automatic_exposure_adapts() -> None:
    """A fixed exposure scales the light; automatic exposure makes bright parts nearly white in any light."""
    wall = DEEP._replace(walls=True, extent=(-50.0, 2.0, -500.0, 500.0))
    linear = [decode(colours(camera(wall, RAW._replace(exposure=e)).sample(0, POSE))) for e in (0.5, 1.0)]
    assert linear[1].mean() == pytest.approx(2.0 * linear[0].mean(), rel=0.02)
    light = np.random.default_rng(1).random((10_000, 3)) * 1e-3
    factor = automatic_exposure(light)
    assert np.percentile((factor * light).max(axis=1), 98.0) == pytest.approx(0.9, rel=0.02)
    assert automatic_exposure(np.zeros((10, 3))) == 1.0
    for depth in (4.0, 40.0):
        picture = colours(camera(FLAT._replace(depth=depth + 4.0), RAW._replace(exposure=0.0), DOWN).sample(
            0, State((0.0, 0.0, depth))
        ))  # fmt: skip
        assert np.percentile(picture.max(axis=2), 98.0) == pytest.approx(243, abs=4)


def test_noise_follows_the_electron_count() -> None:
    """The variance is signal / full well + (read noise / full well)², in shares of white."""
    model = RAW._replace(full_well=1000.0, read_noise=20.0)
    sensor = camera(FLAT, model)
    for signal in (0.0, 0.25, 0.5):
        light = np.full((61 * 81, 3), signal, np.float32)
        rgb, _ = sensor._image_sensor.develop(light, np.ones(61 * 81))
        decoded = decode(np.frombuffer(rgb, np.uint8))
        if signal:
            assert decoded.std() == pytest.approx(sqrt(signal / 1000.0 + 0.02**2), rel=0.05)
            assert decoded.mean() == pytest.approx(signal, rel=0.01)
        else:
            assert 0.3 < (decoded > 0.0).mean() < 0.55  # half of the noise is below black


def test_vignetting_darkens_the_corners() -> None:
    eye = camera(FLAT, RAW._replace(vignetting=1.0, field_of_view=radians(80.0)))
    rgb, _ = eye._image_sensor.develop(np.full((61 * 81, 3), 0.5, np.float32), np.ones(61 * 81))
    picture = decode(np.frombuffer(rgb, np.uint8).reshape(61, 81, 3))
    axial = cos(np.arctan(hypot(40.0, 30.0) * tan(radians(40.0)) / 40.5))
    assert picture[0, 0, 0] == pytest.approx(0.5 * axial**4, rel=0.02)
    assert picture[30, 40, 0] == pytest.approx(0.5, rel=0.02)


def test_depth_noise_grows_with_the_square_of_depth() -> None:
    for height, expected in ((2.0, 0.008), (4.0, 0.032)):
        model = RAW._replace(depth_noise=0.002)
        found = depths(camera(FLAT, model, DOWN).sample(0, State((0.0, 0.0, 12.0 - height))))
        assert found.std() == pytest.approx(expected, rel=0.05)
        assert found.mean() == pytest.approx(height, abs=0.003)


def test_shading_follows_the_direction_of_a_face(monkeypatch: pytest.MonkeyPatch) -> None:
    """A face that looks up is 1 / 0.6 times as bright as a wall; from below the surface is bright."""
    monkeypatch.setattr(scenery, "SCALES", ((0.01, 0.0), (0.089, 0.0)))
    world = FLAT._replace(box=(Box(5.0, 0.0, 2.0, 2.0, top=9.0),))
    sample = camera(world, TRUE._replace(exposure=1.0, width=161, height=121)).sample(0, State((0.0, 0.0, 7.0)))
    picture, rows = colours(sample), np.nonzero(labels(sample)[:, 80] == 1)[0]
    top, wall = picture[rows[0] + 1 : rows[0] + 5, 70:91], picture[rows[-1] - 8 : rows[-1], 70:91]
    assert decode(top).mean() == pytest.approx(decode(wall).mean() / 0.6, rel=0.02)
    up = camera(FLAT, TRUE._replace(exposure=1.0), Mounting(orientation=(0.0, radians(90.0), 0.0))).sample(0, POSE)
    assert (colours(up)[15:46, 20:61] == 255).all()
    assert depths(up) == pytest.approx(np.full((61, 81), 8.0), abs=1e-6)


def test_the_sky_is_visible_within_snells_window_only() -> None:
    """The sky within 45 deg of the vertical is as bright as overhead; beyond 52 deg there is the water, here none."""
    wide = TRUE._replace(exposure=0.5, field_of_view=radians(130.0))
    up = camera(FLAT, wide, Mounting(orientation=(0.0, radians(90.0), 0.0))).sample(0, POSE)
    across, down = tangents(up)
    slope, light = np.hypot(across, down), decode(colours(up)).mean(axis=-1)
    assert light[slope < tan(radians(44.0))] == pytest.approx(0.5, abs=0.01)
    assert light[slope > tan(radians(53.0))].max() == 0.0
    wet = camera(FLAT, wide._replace(ground_truth=False, water="IB", vignetting=0.0, exposure=1.0, full_well=1e7))
    level = decode(colours(wet.sample(0, POSE)))
    assert level[20] == pytest.approx(level[30], abs=0.03), "the surface far ahead is as dark as the water there"


# --- points


@pytest.mark.parametrize("distortion", [(0.0,) * 5, (-0.2, 0.05, 0.002, -0.003, 0.01)])
def test_each_point_projects_to_its_pixel(distortion: Any) -> None:
    """Each is as deep as its pixel, and comes back to it through the lens; what is not seen is no number."""
    model = TRUE._replace(points=True, distortion=distortion, max_range=20.0)
    sample = camera(FLAT._replace(cylinder=(Cylinder(9.0, 3.0, 1.0),)), model).sample(0, POSE)
    assert sample.points is not None
    forward, right, down = np.frombuffer(sample.points, np.float32).reshape(61, 81, 3).transpose(2, 0, 1)
    has_depth = np.isfinite(depths(sample))
    assert 1000 < has_depth.sum() < has_depth.size
    assert (np.isnan(forward) == ~has_depth).all()
    assert forward[has_depth] == pytest.approx(depths(sample)[has_depth], abs=1e-5)
    fx, fy, cx, cy = sample.intrinsics
    x, y = distort((right / forward).astype(float), (down / forward).astype(float), distortion)
    columns, rows = np.meshgrid(np.arange(81), np.arange(61))
    assert (fx * x + cx)[has_depth] == pytest.approx(columns[has_depth], abs=1e-4)
    assert (fy * y + cy)[has_depth] == pytest.approx(rows[has_depth], abs=1e-4)
    on_seabed = labels(sample) == SEABED
    assert down[on_seabed] == pytest.approx(np.full(on_seabed.sum(), 4.0), abs=1e-5)


def test_points_have_the_measured_depths() -> None:
    model = CameraModel(width=81, height=61, points=True, depth_noise=0.01)
    sample = camera(FLAT, model, DOWN).sample(0, POSE)
    assert sample.points is not None
    assert np.frombuffer(sample.points, np.float32)[::3] == pytest.approx(depths(sample).ravel(), abs=1e-5)
    assert depths(sample).std() > 0.01
    assert camera(FLAT, model._replace(points=False)).sample(0, POSE).points is None


@pytest.mark.parametrize(
    ("keys", "message"),
    [({"depth": False}, "needs depth = true"), ({"width": 4096, "height": 1000}, "more than 4000000")],
)
def test_invalid_point_cloud_keys_are_refused(keys: dict[str, Any], message: str) -> None:
    assert message in str(CameraModel(points=True, **keys).validate())
    assert CameraModel(**keys).validate() is None
