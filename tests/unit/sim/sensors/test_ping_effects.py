"""Effects on the pings of all imaging sonars: ringing, own motion, and a scanning sonar's side lobes."""

from math import atan2, cos, exp, radians, sin, sqrt, tan
from typing import Any

import numpy as np
import pytest

from sim.dynamics import State
from sim.environment.obstacles import Box
from sim.environment.seawater.water_column import SOUND_SPEED
from sim.environment.world import World
from sim.rays import solids
from sim.rotations import from_euler
from sim.sensors.imaging.echoes import array_pattern
from sim.sensors.imaging.forward_sonar import ForwardSonar, ForwardSonarModel
from sim.sensors.imaging.scanning_sonar import ScanningSonar, ScanningSonarModel
from sim.sensors.imaging.side_scan import SideScan, SideScanModel
from sim.sensors.mounting import Mounting
from sim.sensors.sensor_set import read_sensors
from tests.support.fitted import DEEP, FLAT, image, scene

FORWARD = ForwardSonarModel(
    ground_truth=True, beams=121, sector=radians(60.5), min_range=0.0, side_lobes=0.0, surface_strength=-200.0
)
SCAN = SideScanModel(ground_truth=True, max_range=60.0, slices=41, surface_strength=-200.0)
HEAD = ScanningSonarModel(
    ground_truth=True, bins=500, min_range=0.0, max_range=25.0, slices=31, side_lobes=0.0, surface_strength=-200.0
)
BALL = solids.sphere((0.0, 0.0, 0.0), 0.5)


def make_sensor(kind: Any, model: Any, world: World = DEEP) -> Any:
    return kind(model, Mounting(), 1, scene(world))


def at_depth(depth: float, *nu: float) -> State:
    return State((0.0, 0.0, depth), (1.0, 0.0, 0.0, 0.0), nu or (0.0,) * 6)


def sweep(model: ScanningSonarModel) -> tuple[Any, Any]:
    """Return the angles of a sweep from port to starboard past a ball 10 m ahead, and its echoes, pings x bins."""
    sonar = make_sensor(ScanningSonar, model._replace(angle_min=radians(-36.0), angle_max=radians(36.0)))
    sonar.add(BALL, State((10.0, 0.0, 10.0)))
    samples = [sonar.sample(ping, at_depth(10.0)).echoes for ping in range(81)]
    return np.array([s.beams[0] for s in samples]), np.array([image(s)[:, 0] for s in samples])


# --- ringing


def test_ringing_hides_near_echoes_only() -> None:
    quiet, ringing = (
        image(make_sensor(ForwardSonar, ForwardSonarModel(min_range=0.0, ringing=r)).sample(0, at_depth(10.0)))
        for r in (0.0, 2.0)
    )
    assert ringing[:5].min() == 255
    assert quiet[:5].max() < 100
    falling = ringing[5:20].mean(axis=1)
    assert (np.diff(falling[falling < 255.0]) < 5.0).all()
    assert np.abs(ringing[30:].astype(int) - quiet[30:]).max() <= 1
    truth = make_sensor(ForwardSonar, FORWARD._replace(ringing=2.0)).sample(0, at_depth(10.0))
    assert not image(truth)[:20].any(), "the ground truth has none"


def test_a_ping360_samples_from_zero_and_measures_no_distance_in_its_ringing() -> None:
    model = read_sensors({"scanning_sonar": {"device": "ping360"}}, "test")["scanning_sonar"].model
    assert (model.min_range, model.ringing) == (0.0, 0.75)
    near = FLAT._replace(box=(Box(1.5, 0.0, 2.0, 20.0),))  # 0.5 m ahead
    sonar = make_sensor(ScanningSonar, model._replace(angle_min=-0.01, angle_max=0.01, step=0.01), near)
    _, scan, echoes = sonar.sample(0, at_depth(10.0))
    grey = np.frombuffer(echoes.intensities, np.uint8)
    assert grey[0] == 255
    assert (np.diff(grey[:10].astype(int)) < 0).all(), "it rings on, and falls"
    assert scan.limits[0] == 0.75
    assert scan.ranges[0] == -np.inf
    assert model._replace(ringing=50.0).validate()
    assert model._replace(ringing=10.0, max_range=5.0).validate()
    assert "beam_width" in str(model._replace(beam_width=0.0).validate())


def test_side_scan_lines_begin_with_bright_ringing() -> None:
    sample = make_sensor(SideScan, SideScanModel(), FLAT).sample(0, at_depth(8.0))
    for side in (sample.port, sample.starboard):
        grey = np.frombuffer(side, np.uint8)
        assert grey[:2].min() == 255
        assert grey[10:110].max() < 100, "then water"


# --- side lobes of a scanning sonar


def test_side_lobes_of_a_scanning_sonar_act_on_both_paths() -> None:
    """A ball is received by the pattern squared, to 1.5 dB, in pings that look past it."""
    angles, echoes = sweep(HEAD._replace(side_lobes=13.26))
    received = echoes.sum(axis=1)
    aside = np.linspace(-1.0, 1.0, 51)
    across, weights = aside * atan2(0.5, 10.0), 1.0 - aside**2  # what a ball scatters by Lambert's rule, by its columns

    def pattern(angle: float) -> float:
        return float(np.average(array_pattern(angle + across, HEAD.beam_width, 13.26) ** 2, weights=weights))

    for low, high in ((5.5, 8.5), (8.5, 12.0), (12.0, 15.5)):
        on = (np.abs(angles) > radians(low)) & (np.abs(angles) < radians(high))
        wanted = np.mean([pattern(angle) for angle in angles[on]]) / pattern(0.0)
        assert received[on].mean() / received.max() == pytest.approx(wanted, rel=0.4)
    assert not received[np.abs(angles) > radians(30.0)].any()
    angles, echoes = sweep(HEAD)
    assert not echoes[np.abs(angles) > radians(6.0)].any()
    assert echoes.sum(axis=1).max() == pytest.approx(received.max(), rel=0.02)


# --- glint


@pytest.mark.parametrize("glint", [10.0, 25.0])
def test_a_smooth_wall_has_a_glint_at_a_right_angle(glint: float) -> None:
    """The gain is `glint` dB straight on, exp(-tan² / 0.02) of it at 6 deg, 0 at 40 deg, and 0 for the seabed."""
    model = FORWARD._replace(beams=1, sector=radians(0.2), beam_height=radians(0.2), rays=9)

    def echo(degrees: float, model: ForwardSonarModel, world: World = DEEP) -> float:
        turned = world._replace(box=(Box(20.0, 0.0, 0.02, 40.0, radians(degrees)),))
        return float(image(make_sensor(ForwardSonar, model, turned).sample(0, at_depth(10.0))).sum())

    for degrees, lobe in ((0.0, 1.0), (6.0, exp(-(tan(radians(6.0)) ** 2) / 0.02)), (40.0, 0.0)):
        ratio = echo(degrees, model._replace(glint=glint)) / echo(degrees, model)
        assert ratio == pytest.approx(1.0 + (10.0 ** (0.1 * glint) - 1.0) * lobe, rel=0.01)
    down = [
        np.frombuffer(make_sensor(SideScan, SCAN._replace(glint=g), FLAT).sample(0, at_depth(10.0)).port, np.float32)
        for g in (0.0, glint)
    ]
    assert (down[0] == down[1]).all()


# --- motion within a ping


def test_an_approaching_sonar_measures_shorter_ranges() -> None:
    """The sound arrives where the sonar is by then: 1 - v / c of the range, ahead; unchanged across."""
    sonar = make_sensor(ForwardSonar, FORWARD._replace(max_range=60.0))
    sonar._pinger.add(solids.half_space((-1.0, 0.0, 0.0), -50.0), State())
    still, moving = (sonar._pinger.ping(0, at_depth(10.0, v, 0.0, 0.0, 0.0, 0.0, 0.0)) for v in (0.0, 15.0))
    is_hit = np.isfinite(still.ranges)
    toward = sonar._pinger._directions[is_hit, 0]
    assert is_hit.sum() > 1000
    assert moving.ranges[is_hit] / still.ranges[is_hit] == pytest.approx(1.0 - 15.0 / SOUND_SPEED * toward, abs=1e-9)


@pytest.mark.parametrize("rate", [0.5, -0.8])
def test_a_turning_forward_sonar_measures_bearings_at_reception(rate: float) -> None:
    """A sonar that turns to starboard detects a ball at 45 m, 60 ms away, farther to port."""
    model = FORWARD._replace(beam_width=radians(0.6))
    sonar = make_sensor(ForwardSonar, model)
    angle, distance = radians(5.0), 45.0
    sonar.add(BALL, State((distance * cos(angle), distance * sin(angle), 10.0)))
    sample = sonar.sample(0, at_depth(10.0, 0.0, 0.0, 0.0, 0.0, 0.0, rate))
    across = image(sample).sum(axis=0)
    found = (across * np.array(sample.beams)).sum() / across.sum()
    assert found == pytest.approx(angle - rate * 2.0 * (distance - 0.4) / SOUND_SPEED, abs=radians(0.1))
    still = image(sonar.sample(0, at_depth(10.0)))
    assert across.sum() == pytest.approx(still.sum(), rel=0.02)


def test_a_turning_side_scan_receives_less_from_far_ranges() -> None:
    """A turn of 8 deg/s moves the beam of 0.8 deg by 0.64 deg until 60 m, 80 ms away: it receives less of it."""
    rate, width = radians(8.0), SCAN.beam_width
    scan = make_sensor(SideScan, SCAN._replace(beam_height=radians(30.0)), FLAT)
    resting, turning = (
        np.frombuffer(scan.sample(0, at_depth(10.0, 0.0, 0.0, 0.0, 0.0, 0.0, r)).starboard, np.float32)
        for r in (0.0, rate)
    )
    along = np.linspace(-radians(0.95), radians(0.95), 2001)
    sent_pattern = array_pattern(along, width, 1e3)
    for number in (200, 400, 590):
        ranges = (number + 0.5) * 0.1
        # The beam is turned about the vertical: less so for what lies below.
        late = rate * 2.0 * ranges / SOUND_SPEED * sqrt(1.0 - (10.0 / ranges) ** 2)
        wanted = (sent_pattern * array_pattern(along + late, width, 1e3)).sum() / (sent_pattern**2).sum()
        window = slice(number - 10, number + 10)
        assert turning[window].sum() / resting[window].sum() == pytest.approx(wanted, abs=0.03)
    assert turning[590] < 0.5 * resting[590]
    assert np.isfinite(turning).all(), "also straight down, where the beam receives nothing"


def test_a_scanning_head_applies_motion_along_its_own_axes() -> None:
    """A wall to starboard is nearer to a sonar that points and moves there."""
    model = HEAD._replace(angle_min=radians(89.0), angle_max=radians(91.0), step=radians(1.0))
    sonar = make_sensor(ScanningSonar, model)
    pinger = sonar._echo_recorder._pingers[0]
    pinger.add(solids.half_space((0.0, -1.0, 0.0), -20.0), State())
    head = from_euler(0.0, 0.0, radians(90.0))
    still, moving = (pinger.ping(0, at_depth(10.0, 0.0, v, 0.0, 0.0, 0.0, 0.0), head) for v in (0.0, 15.0))
    nearest = still.ranges.argmin()
    assert still.ranges[nearest] == pytest.approx(20.0, abs=0.01)
    assert moving.ranges[nearest] / still.ranges[nearest] == pytest.approx(1.0 - 15.0 / SOUND_SPEED, abs=1e-5)
