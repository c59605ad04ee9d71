"""Forward-looking sonar against planes, steps, spheres and cylinders worked out by hand."""

from math import asin, atan2, exp, log10, radians, sin
from typing import Any

import numpy as np
import pytest

from sim.dynamics import State
from sim.environment.bottom import Bottom
from sim.environment.obstacles import Box, Cylinder
from sim.environment.ocean import Ocean, Profile, Waves
from sim.environment.relief import Step
from sim.environment.seawater.absorption import francois_garrison
from sim.environment.terrain import Terrain, covering
from sim.environment.world import World
from sim.rotations import from_euler
from sim.sensors.error import ErrorModel
from sim.sensors.imaging.echoes import beam_pattern, first_null
from sim.sensors.imaging.fan_picture import render_fan
from sim.sensors.imaging.forward_sonar import ForwardSonar, ForwardSonarModel
from sim.sensors.imaging.range_image import RangeImageModel, RangeImager
from sim.sensors.imaging.samples import SonarImageSample
from sim.sensors.mounting import Mounting
from sim.sensors.surface import submersion
from tests.support.fitted import DEEP, EXACT, EXTENT, FLAT, image, scene

TRUE = ForwardSonarModel(
    ground_truth=True, beams=65, sector=radians(65.0), rays=60, min_range=0.0, side_lobes=0.0, surface_strength=-200.0
)
AHEAD = State((0.0, 0.0, 10.0))


def forward(
    world: World, model: ForwardSonarModel = TRUE, mounting: Mounting = Mounting(), seed: int = 1
) -> ForwardSonar:
    return ForwardSonar(model, mounting, seed, scene(world))


def facing_wall(distance: float) -> World:
    return DEEP._replace(walls=True, extent=(-50.0, distance, -500.0, 500.0))


# --- ranges


def test_a_wall_has_exact_ranges() -> None:
    """Each ray's range is that of the wall along it, up to the reach; the patches' edges touch and lie on it too."""
    sonar = forward(DEEP._replace(box=(Box(18.0, 0.0, 2.0, 300.0),)), TRUE._replace(max_range=15.0))
    echoes = sonar._pinger.ping(0, AHEAD)
    assert echoes is not None
    directions, edges = sonar._pinger._aperture[:2]
    on_wall, at_edges = 17.0 / directions[..., 0] < 1.25 * 15.0, 17.0 / edges[..., 0]
    ranges, far = (x.reshape(directions.shape[:2]) for x in (echoes.ranges, echoes.far))
    assert ranges == pytest.approx(np.where(on_wall, 17.0 / directions[..., 0], np.inf), abs=1e-6)
    assert np.maximum(at_edges[:, 1:], at_edges[:, :-1])[on_wall] == pytest.approx(far[on_wall], abs=1e-6)


def test_an_object_appears_in_the_bin_of_its_range() -> None:
    """The first bin that echoes a pile 17.03 m ahead begins at 17.0 m; the others lie behind it."""
    world = DEEP._replace(cylinder=(Cylinder(18.03, 0.0, 1.0),))
    column = image(forward(world).sample(0, AHEAD))[:, 32]
    assert np.nonzero(column)[0][0] == 170
    assert column[170:173].sum() > 0.5 * column.sum()


def test_a_step_echoes_at_its_position() -> None:
    """A cliff 6 m high from north 24 to 25: its face is far brighter than the seabed before it, behind is shadow."""
    grid = covering(EXTENT, 1.0)
    world = FLAT._replace(terrain=Terrain(grid, Step(20.0, 6.0, north=25.0).depths(grid), 20.0))
    model = TRUE._replace(beams=1, sector=radians(1.0), rays=400)
    column = image(forward(world, model).sample(0, State((0.0, 0.0, 15.0))))[:, 0]
    assert 10.0 * log10(column[242:250].max() / column[230:238].max()) > 10.0
    assert column[245:].argmax() < 8
    assert column[290:].max() < 1e-6 * column.max()  # the sonar is below its edge


# --- intensities


@pytest.mark.parametrize("distance", [5.0, 10.0, 40.0])
def test_a_walls_echo_falls_with_range_as_the_sonar_equation(distance: float) -> None:
    """A thin beam fades by mu dO / r² 10^(-2 alpha r / 10)."""
    model = TRUE._replace(beams=1, sector=radians(1.0), beam_height=radians(0.5), rays=9)
    sonar = forward(facing_wall(distance), model)
    total = image(sonar.sample(0, AHEAD)).sum()
    alpha = francois_garrison(750e3)
    spread = sonar._pinger._aperture.weights.sum()
    assert total == pytest.approx(0.01 * spread / distance**2 * 10.0 ** (-0.2 * alpha * distance), rel=1e-3)


def test_a_flat_seabeds_echo_equals_its_integral() -> None:
    """Every bin of one beam equals quadrature of mu sin(e) b² cos(e) de da / r² with r = h / sin(e)."""
    model = TRUE._replace(beams=1, sector=radians(1.0), rays=200, range_step=0.5)
    column = image(forward(FLAT, model).sample(0, AHEAD))[:, 0]
    alpha, lobe = francois_garrison(750e3), first_null(model.beam_height)
    for number in range(60, 100, 7):
        near, far = number * 0.5, (number + 1) * 0.5
        downs = np.linspace(asin(10.0 / far), asin(10.0 / near), 2001)
        ranges = 10.0 / np.sin(downs)
        terms = np.sin(downs) * beam_pattern(downs, model.beam_height) ** 2 * np.cos(downs) / ranges**2
        terms *= 10.0 ** (-0.2 * alpha * ranges - 2.7) * radians(1.0)
        assert column[number] == pytest.approx(np.trapezoid(terms, downs), rel=0.01)
    first = 10.0 / sin(lobe)
    assert not column[: int(first / 0.5)].any()
    assert column[int(first / 0.5) + 1 :].all()  # no gap


def test_there_is_a_shadow_behind_a_pile() -> None:
    """The beams that the pile fills are dark behind all of its height to the end; those beside it are not."""
    world = FLAT._replace(cylinder=(Cylinder(25.0, 0.0, 1.0),))
    picture = image(forward(world).sample(0, State((0.0, 0.0, 14.0))))
    assert picture[200:239, 32].min() > 0.0
    assert picture[270:, 32].max() < 1e-9 * picture[200:239, 32].min()
    assert picture[260:, 20].min() > 0.0


def test_port_is_on_the_left_and_starboard_on_the_right() -> None:
    world = DEEP._replace(cylinder=(Cylinder(20.0, 6.0, 0.5),))
    sample = forward(world).sample(0, AHEAD)
    assert list(sample.beams) == sorted(sample.beams)
    brightest = int(image(sample).sum(axis=0).argmax())
    assert sample.beams[brightest] == pytest.approx(atan2(6.0, 20.0), abs=radians(0.6))
    assert sample.beams[32] == pytest.approx(0.0, abs=1e-12)
    assert sample.beams[0] == pytest.approx(radians(-32.0))


def test_a_wide_beam_spreads_an_echo_by_its_pattern() -> None:
    """A thin pile in the middle beam echoes in the others as the pattern says."""
    world = DEEP._replace(cylinder=(Cylinder(20.0, 0.0, 0.1),))
    model = TRUE._replace(beams=101, sector=radians(25.25), beam_width=radians(2.0))
    across = image(forward(world, model).sample(0, AHEAD)).sum(axis=0)
    angles = np.array(forward(world, model).sample(0, AHEAD).beams)
    on_it = np.abs(angles) < asin(0.1 / 20.0)
    expected = [beam_pattern(angle - angles[on_it], radians(2.0)).sum() for angle in angles]
    assert across / across.max() == pytest.approx(np.array(expected) / max(expected), abs=0.02)


def test_noise_stays_dark_and_a_wall_visible_at_full_range() -> None:
    """The water is open to 120 m: gain that made good all losses whitened 95 % of the last 20 m."""
    model = ForwardSonarModel(max_range=120.0, range_step=0.2, beams=128)
    empty, walled = (image(forward(w, model).sample(0, AHEAD)) / 255.0 for w in (DEEP, facing_wall(70.0)))
    noise = [empty[rows].mean() for rows in (slice(300, 400), slice(400, 500), slice(500, 600))]
    assert noise == pytest.approx([0.135] * 3, abs=0.01)
    assert empty.max() < 0.6
    assert walled[345:352, 60:68].mean() > 2.0 * noise[0]


def test_side_lobes_show_a_pile_in_all_beams() -> None:
    """A pile echoes in all beams at its range, farther off the weaker, if the array has no errors.

    With errors the arc is as bright anywhere. Without side lobes no other beam receives the pile.
    """
    world = DEEP._replace(cylinder=(Cylinder(20.0, 0.0, 0.5),))
    model = TRUE._replace(side_lobes=25.0, side_lobe_floor=0.0)
    picture = image(forward(world, model).sample(0, AHEAD))
    brightest = picture[:, 32].argmax()
    row = picture[brightest]
    assert 0.0 < row[0] < row[24] < 0.01 * row[32]
    floored = [
        image(forward(world, model._replace(side_lobe_floor=30.0), seed=seed).sample(0, AHEAD))[brightest]
        for seed in range(20)
    ]
    lobe = beam_pattern(np.array(forward(world).sample(0, AHEAD).beams), TRUE.beam_width).sum()
    wanted = 10.0**-3.0 * row.sum() / row[32] / lobe
    assert np.mean([row[:20].mean() / row[32] for row in floored]) == pytest.approx(wanted, rel=0.3)
    assert image(forward(world).sample(0, AHEAD))[:, 0].max() == 0.0


# --- the seabed below its grid


def test_the_bottom_texture_is_fixed_to_positions() -> None:
    """The texture is the same from one place with other noise, stays in the mean, and varies more if rougher."""

    def picture(kind: str | None, state: State = AHEAD, seed: int = 1) -> Any:
        bottom = Bottom(kind) if kind else None  # type: ignore[arg-type]
        return image(forward(FLAT._replace(bottom=bottom), seed=seed).sample(0, state))[260:]

    smooth, sand, rock = picture(None), picture("sand"), picture("rock")
    assert smooth.all()
    assert (picture("sand", seed=9) == sand).all()
    ratio = sand / smooth
    assert ratio.std() > 0.1
    assert np.median(ratio) == pytest.approx(1.0, abs=0.3)
    assert 10.0 * log10(np.median(rock / smooth)) == pytest.approx(5.0, abs=3.0)
    assert (rock / smooth / 10.0**0.5).std() > ratio.std()
    moved = picture("sand", State((0.0, 0.0, 10.0), from_euler(0.0, 0.0, radians(10.0))))
    same = np.corrcoef((moved[:, 20] / smooth[:, 20]), (sand[:, 30] / smooth[:, 30]))[0, 1]  # ten beams on
    other = np.corrcoef((moved[:, 20] / smooth[:, 20]), (sand[:, 45] / smooth[:, 45]))[0, 1]
    assert same > 0.8
    assert other < 0.5


# --- pictures


@pytest.mark.parametrize(("row", "beam"), [(0, 0), (19, 11), (7, 3)])
@pytest.mark.parametrize(("encoding", "faint"), [("uint8", 51.0), ("float32", 255.0 * 10.0**-3.2)])
def test_a_fan_shows_a_cell_at_its_range_and_bearing(row: int, beam: int, encoding: Any, faint: float) -> None:
    """Each metre has 50 pixels; the sonar is in the middle of the lower edge. 32 dB weaker is a fifth of 255."""
    beams, echoes = np.linspace(-0.4, 0.7, 12), np.full((20, 12), faint, encoding)
    echoes[row, beam] = 255
    sample = SonarImageSample(0, tuple(beams), 20, 1.0, 0.3, 7e5, 1500.0, 0.1, 0.3, encoding, echoes.tobytes())
    picture = render_fan(sample, 350)
    assert picture.shape == (350, round(2.0 * 350.0 * sin(0.7)))
    assert np.unique(picture) == pytest.approx([0, 51, 255], abs=1)
    assert (picture > 0).sum() == pytest.approx(0.5 * (350**2 - 50**2) * 1.1, rel=0.01)
    y, x = np.nonzero(picture == 255)
    ahead, right = 349 - y, x - 0.5 * picture.shape[1]
    ranges, angles = np.hypot(ahead, right) / 50.0, np.arctan2(right, ahead)
    assert (ranges.min(), ranges.max()) == pytest.approx((1.0 + 0.3 * row, 1.3 + 0.3 * row), abs=0.03)
    sides = np.clip([beams[beam] - 0.05, beams[beam] + 0.05], -0.4, 0.7)
    assert (angles.min(), angles.max()) == pytest.approx(sides, abs=0.03)


def test_time_varied_gain_makes_a_wall_equally_bright_near_and_far() -> None:
    quiet = TRUE._replace(ground_truth=False, looks=0.0, noise_level=0.0, error=EXACT, gain=-10.0, range_step=1.0)
    near, far = (int(image(forward(facing_wall(d), quiet).sample(0, AHEAD))[:, 32].max()) for d in (10.5, 40.5))
    assert near == pytest.approx(far, abs=20)
    flat = quiet._replace(tvg=0.0, gain=-20.0)
    near, far = (int(image(forward(facing_wall(d), flat).sample(0, AHEAD))[:, 32].max()) for d in (10.5, 40.5))
    assert near > 2 * far


def test_ranges_scale_with_the_assumed_speed_of_sound() -> None:
    """The device assumes 1500 m/s; in water of 1450 m/s ranges are 1500 / 1450 times as long."""
    ocean = Ocean(profile=Profile((0.0, 100.0), (1025.0, 1025.0), (1450.0, 1450.0)))
    world = DEEP._replace(cylinder=(Cylinder(30.0, 0.0, 1.0),), ocean=ocean)
    model = TRUE._replace(ground_truth=False, looks=0.0, noise_level=0.0, error=EXACT)
    first = np.nonzero(image(forward(world, model).sample(0, AHEAD))[:, 32])[0][0]
    assert first == int(29.0 * 1500.0 / 1450.0 / 0.1)
    scaled = forward(world, model._replace(error=ErrorModel(offset=2.0))).sample(0, AHEAD)
    assert np.nonzero(image(scaled)[:, 32])[0][0] == int((29.0 * 1500.0 / 1450.0 + 2.0) / 0.1)


def test_range_errors_decay_from_ping_to_ping() -> None:
    """An error that takes 0.2 s to decay is after each ping, at 5 Hz, 1 / e of that before."""
    warming = TRUE._replace(ground_truth=False, rate=5.0, error=ErrorModel(warm_up=2.0, warm_up_time=0.2))
    sonar = forward(facing_wall(17.0), warming)
    echoes = sonar._pinger.ping(0, AHEAD)
    assert echoes is not None
    first, second = (sonar._scale.measure(AHEAD, echoes)[0].ranges[0] - echoes.ranges[0] for _ in range(2))
    assert second / first == pytest.approx(exp(-1.0))


def test_there_are_no_echoes_out_of_the_water() -> None:
    """Nor are there in a trough, below the level of the water at rest."""
    model = TRUE._replace(surface_strength=-30.0)
    assert not image(forward(FLAT, model).sample(0, State((0.0, 0.0, -0.5)))).any()
    assert not RangeImager(RangeImageModel(), Mounting(), 1, scene()).sample(0, State((0.0, 0.0, -0.5))).ranges.any()
    wavy = FLAT._replace(ocean=Ocean(waves=Waves(2.0, 6.0, components=3)))
    trough = next(t for t in range(0, 10**10, 10**8) if submersion(scene(wavy), t, (0.0, 0.0, 0.3)) < 0.0)
    assert not image(forward(wavy, model).sample(trough, State((0.0, 0.0, 0.3)))).any()


def test_parts_above_the_water_do_not_echo() -> None:
    """A tall wall echoes up to the surface only: its upper patches would come earlier from deeper down."""
    model = TRUE._replace(beams=1, sector=radians(1.0), rays=200)
    shallow = forward(facing_wall(20.0), model).sample(0, State((0.0, 0.0, 1.0)))
    deep = forward(facing_wall(20.0), model).sample(0, State((0.0, 0.0, 30.0)))
    assert 0.5 < image(shallow).sum() / image(deep).sum() < 0.75


def test_volume_reverberation_fills_a_beam_up_to_an_obstacle() -> None:
    """Open water echoes s_v b² dO dr / r² less absorption; behind a wall across the whole beam there is no echo."""
    model = TRUE._replace(volume_strength=-60.0)
    sonar = forward(DEEP, model)
    picture = image(sonar.sample(0, AHEAD))
    weights = sonar._pinger._aperture.weights[32].sum() * sonar._former.powers[32].sum()
    ranges = (np.arange(len(picture)) + 0.5) * 0.1
    absorbed = 10.0 ** (-0.2 * sonar._pinger.absorption * ranges)
    # up to 25 m no ray has met the surface
    assert picture[1:250, 32] == pytest.approx((1e-6 * weights * 0.1 / ranges**2 * absorbed)[1:250], rel=1e-4)
    assert not image(forward(DEEP).sample(0, AHEAD))[:250].any()
    walled = image(forward(facing_wall(17.0), model).sample(0, AHEAD))
    assert walled[100, 32] == pytest.approx(picture[100, 32])
    assert walled[250, 32] < 1e-3 * picture[250, 32]
