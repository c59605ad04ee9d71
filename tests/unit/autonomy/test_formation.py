"""The potential fields: each the gradient of its potential, numbers by hand, and vehicles that keep apart."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.autonomy.fleets.formation import (
    Body,
    FieldSettings,
    Vector,
    attraction,
    communication,
    formation_error,
    repulsion,
    resultant,
    separation,
)
from hil.autonomy.fleets.localisation_noise import LocalisationNoise
from hil.common.errors import ConfigError

METRES = st.floats(-8.0, 8.0)
POINTS = st.tuples(METRES, METRES)
ORIGIN = (0.0, 0.0)


def test_attraction_has_the_value_worked_out_by_hand() -> None:
    """A gain of 0.6 1/s gives 0.18 m/s at 0.3 m from the target; 5 m away the limit of 0.3 m/s holds, along 3-4-5."""
    assert attraction(ORIGIN, (0.3, 0.0), 0.6, 0.5) == pytest.approx((0.18, 0.0))
    assert attraction(ORIGIN, (3.0, 4.0), 0.6, 0.5) == pytest.approx((0.18, 0.24))
    assert attraction(ORIGIN, ORIGIN, 0.6, 0.5) == (0.0, 0.0)


def test_repulsion_has_the_value_worked_out_by_hand() -> None:
    """A rim 0.5 m away within a reach of 1 m, the place 2 m behind the body, pushes by the formula's two parts:
    (1/0.5 - 1) 2² / 0.5² = 16 away from the body, and (2 - 1)² 2 = 2 back.
    """
    body = Body((1.0, 0.0), 0.5)
    assert repulsion(ORIGIN, (2.0, 0.0), body, 1.0, 1.0) == pytest.approx((-16.0 + 2.0, 0.0))
    assert repulsion((0.0, 0.0), (0.0, 0.0), body, 1.0, 1.0) == pytest.approx((0.0, 0.0))  # it is at its target
    assert repulsion((-0.5, 0.0), (2.0, 0.0), body, 1.0, 1.0) == (0.0, 0.0)  # the reach ends here


def test_communication_has_the_value_worked_out_by_hand() -> None:
    """A neighbour at 5 m, of a range of 6 m that is comfortable to 4 m, attracts by (1/1 - 1/2) / 1² = 0.5. Nothing
    attracts nearer or beyond.
    """
    assert communication(ORIGIN, (0.0, 5.0), 1.0, 4.0, 6.0) == pytest.approx((0.0, 0.5))
    assert communication(ORIGIN, (3.0, 4.0), 1.0, 4.0, 6.0) == pytest.approx((0.3, 0.4))
    assert communication(ORIGIN, (0.0, 4.0), 1.0, 4.0, 6.0) == (0.0, 0.0)
    assert communication(ORIGIN, (0.0, 6.1), 1.0, 4.0, 6.0) == (0.0, 0.0)


@given(POINTS, POINTS, st.lists(POINTS, max_size=4), st.lists(POINTS, max_size=2))
def test_the_resultant_is_the_sum_limited_to_top_speed(
    position: Vector, target: Vector, neighbours: list[Vector], obstacles: list[Vector]
) -> None:
    settings = FieldSettings()
    bodies, rocks = [Body(n, 0.5) for n in neighbours], [Body(o, 0.8) for o in obstacles]
    moving = 0.1, -0.05
    north, east = resultant(position, target, moving, bodies, rocks, settings)
    assert math.hypot(north, east) <= settings.max_speed + 1e-9
    s = settings
    terms = [moving, attraction(position, target, s.attraction, s.conic)]
    for body in bodies:
        if math.dist(body.position, position) < s.communication_range:
            terms.append(repulsion(position, target, body, s.repulsion, s.repulsion_range))
            terms.append(communication(position, body.position, s.communication, s.comfortable, s.communication_range))
    terms += [repulsion(position, target, rock, s.repulsion, s.repulsion_range) for rock in rocks]
    whole = math.fsum(part[0] for part in terms), math.fsum(part[1] for part in terms)
    size = math.hypot(*whole)
    share = min(1.0, s.max_speed / size) if size > 1e-3 else 1.0
    assert (north, east) == pytest.approx((share * whole[0], share * whole[1]), rel=1e-6, abs=1e-6)


@given(POINTS, st.lists(POINTS, min_size=1, max_size=3))
def test_a_neighbour_that_need_not_stay_in_range_exerts_no_attraction(
    position: Vector, neighbours: list[Vector]
) -> None:
    """The velocity is that with a gain of 0 of the field of communication; repulsion stays."""
    mute = FieldSettings(communication=0.0)
    bodies = [Body(n, 0.5, stays_in_range=False) for n in neighbours]
    loose = resultant(position, ORIGIN, ORIGIN, bodies, [], FieldSettings())
    assert loose == resultant(position, ORIGIN, ORIGIN, [Body(n, 0.5) for n in neighbours], [], mute)


@pytest.mark.parametrize("seed", range(8))
def test_four_vehicles_that_swap_corners_do_not_collide(seed: int) -> None:
    """Each goes to the far corner of a square at once, with positions unsure by 0.05 m: the fields' worst case."""
    settings, noise, step, min_separation = FieldSettings(), LocalisationNoise(0.05, seed), 0.1, 0.5
    positions: list[Vector] = [(0.0, 0.2), (3.1, 0.0), (3.0, 3.0), (-0.2, 3.0)]
    goals = [(3.0, 3.0), (0.0, 3.0), (0.0, 0.0), (3.0, 0.0)]
    least = math.inf
    for _ in range(1500):
        measured = [noise.measured(position) for position in positions]
        expected = [
            resultant(
                own_position,
                goals[k],
                ORIGIN,
                [Body(p, min_separation) for p in (*measured[:k], *measured[k + 1 :])],
                [],
                settings,
            )
            for k, own_position in enumerate(measured)
        ]
        positions = [(p[0] + v[0] * step, p[1] + v[1] * step) for p, v in zip(positions, expected, strict=True)]
        least = min(least, separation(positions))
    assert least > min_separation
    assert max(math.dist(p, q) for p, q in zip(positions, goals, strict=True)) < 0.2


def test_a_vehicle_stays_within_the_range_of_its_neighbour() -> None:
    """The link's range of 5 m holds although one goes for a target 9 m away and the other stays."""
    settings, step = FieldSettings(), 0.1
    runner, other = (3.5, 0.0), (0.0, 0.0)
    for _ in range(600):
        velocity = resultant(runner, (9.0, 0.0), ORIGIN, [Body(other, 0.5)], [], settings)
        runner = runner[0] + velocity[0] * step, runner[1] + velocity[1] * step
    assert 4.0 < math.dist(runner, other) < 5.0
    without = resultant((4.9, 0.0), (9.0, 0.0), ORIGIN, [], [], settings)
    assert without[0] > 0.2


def test_formation_error_and_separation_have_the_values_worked_out_by_hand() -> None:
    """A formation moved as a whole has no error; one vehicle 0.4 m off leaves 0.3 m at best by the middle."""
    targets = [(0.0, 0.0), (3.0, 0.0), (6.0, 0.0), (9.0, 0.0)]
    shifted = [(n + 5.0, e - 2.0) for n, e in targets]
    assert formation_error(shifted, targets) == pytest.approx(0.0, abs=1e-12)
    shifted[0] = (5.0, -2.4)
    assert formation_error(shifted, targets) == pytest.approx(0.3)
    assert separation([(0.0, 0.0), (3.0, 4.0), (3.0, 3.0)]) == pytest.approx(1.0)
    assert separation([(0.0, 0.0)]) == math.inf


def test_localisation_noise_has_zero_mean_and_the_stated_size() -> None:
    noise = LocalisationNoise(0.2, 7)
    errors = [value for _ in range(20_000) for value in noise.measured(ORIGIN)]
    mean = math.fsum(errors) / len(errors)
    assert mean == pytest.approx(0.0, abs=0.005)
    assert math.fsum((e - mean) ** 2 for e in errors) / len(errors) == pytest.approx(0.04, rel=0.03)
    assert sum(abs(e) > 0.4 for e in errors) / len(errors) == pytest.approx(0.0455, abs=0.005)
    again = LocalisationNoise(0.2, 7)
    assert [value for _ in range(20_000) for value in again.measured(ORIGIN)] == errors
    with pytest.raises(ConfigError, match="give 0 or more"):
        LocalisationNoise(-0.1, 0)


def test_contradicting_settings_are_refused() -> None:
    assert FieldSettings().validate() is None
    assert "below communication_range" in str(FieldSettings(comfortable=7.0).validate())
