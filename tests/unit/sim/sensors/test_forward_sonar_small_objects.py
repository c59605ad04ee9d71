"""Forward-looking sonar against objects that are smaller than the distance between its rays."""

from math import cos, radians, sin, sqrt
from random import Random

import numpy as np
import pytest

from sim.dynamics import State
from sim.environment.world import World
from sim.rays import solids
from sim.rotations import from_euler
from sim.sensors.imaging.forward_sonar import ForwardSonarModel
from tests.unit.sim.sensors.test_forward_sonar import AHEAD, DEEP, TRUE, facing_wall, forward, image


def echoes_of_ball(radius: float, seed: int, model: ForwardSonarModel, floor: World = DEEP) -> tuple[float, float]:
    """Return the echoes of a ball about 20 m away, somewhere in the fan, and those before it."""
    chance = Random(seed)
    across, down, distance = radians(chance.uniform(-28, 28)), radians(chance.uniform(-8, 8)), chance.uniform(19, 21)
    sonar = forward(floor, model)
    empty = image(sonar.sample(0, AHEAD))
    place = distance * cos(down) * cos(across), distance * cos(down) * sin(across), 10.0 + distance * sin(down)
    sonar.add(solids.sphere((0.0, 0.0, 0.0), radius), State(place))
    more = image(sonar.sample(0, AHEAD)) - empty
    first = int((distance - radius) / 0.1)
    return float(more[first : first + 5].clip(0.0).sum()), float(more[: first - 1].clip(0.0).sum())


@pytest.mark.parametrize("radius", [0.15, 0.075])
def test_a_ball_between_rays_is_always_detected(radius: float) -> None:
    """Every ping of the usual fan of 32 rays a beam shows it, about as bright, and nothing comes before it."""
    model = TRUE._replace(rays=32, beams=256)
    found = [echoes_of_ball(radius, seed, model) for seed in range(25)]
    echoes = np.array(found)[:, 0]
    assert echoes.min() > 0.25 * np.median(echoes)
    assert max(before for _, before in found) < 1e-6 * np.median(echoes)


@pytest.mark.parametrize("radius", [0.12, 0.5])
def test_nothing_comes_from_behind_a_ball(radius: float) -> None:
    """Rays that touch a ball go sqrt(d² - r²); no echo is farther than that by more than the ball is deep."""
    sonar = forward(DEEP, TRUE._replace(range_step=0.01, max_range=4.0))
    sonar.add(solids.sphere((0.0, 0.0, 0.0), radius), State((0.9, 0.0, 10.0)))
    sums = image(sonar.sample(0, AHEAD)).sum(axis=1)
    touching = sqrt(0.9**2 - radius**2)
    behind = touching + touching - (0.9 - radius)
    assert sums[int(behind / 0.01) + 1 :].max() < 1e-9 * sums.max()
    assert sums[int((0.9 - radius) / 0.01) : int(touching / 0.01)].sum() > 0.99 * sums.sum()


def test_a_split_cell_is_counted_once() -> None:
    """A ball takes from a wall behind it what it hides, no more; beams beside it receive the wall as before."""
    sonar = forward(facing_wall(25.0), TRUE._replace(rays=32))
    alone = image(sonar.sample(0, AHEAD))
    sonar.add(solids.sphere((0.0, 0.0, 0.0), 0.2), State((15.0, 0.0, 10.0)))
    both = image(sonar.sample(0, AHEAD))
    wall = slice(245, 400)
    assert both[wall].sum() < alone[wall].sum()
    assert both[wall].sum() == pytest.approx(alone[wall].sum(), rel=0.01)
    assert both[wall, :20] == pytest.approx(alone[wall, :20], rel=1e-5)
    hidden = alone[wall, 32].sum() - both[wall, 32].sum()
    assert 0.0 < hidden < 0.2 * alone[wall, 32].sum()


def test_a_thin_rope_is_detected_in_every_beam_that_crosses_it() -> None:
    """The rope is 5 cm thick, level, 1.5 m below the sonar and 15 m ahead."""
    sonar = forward(DEEP, TRUE._replace(rays=24, beams=128, beam_width=radians(0.5)))
    across = from_euler(radians(90.0), 0.0, 0.0)
    sonar.add(solids.cylinder((0.0, 0.0, 0.0), 0.025, 6.0), State((15.0, 0.0, 11.5), across))
    picture = image(sonar.sample(0, AHEAD))
    beams = np.array(sonar.sample(0, AHEAD).beams)
    crossing = np.abs(np.tan(beams)) < 5.8 / 15.0
    assert crossing.sum() > 80
    assert picture[:, crossing].sum(axis=0).min() > 0.0
