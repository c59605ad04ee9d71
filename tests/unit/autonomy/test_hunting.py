"""The reference platform's hunt: four vehicles, two formations, fifty seeds each of localisation noise."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.autonomy.fleets.formation import FieldSettings, Vector, separation
from hil.autonomy.fleets.hunting import Criteria, Hunter, HuntPlan, Judgement, Referee, Report
from hil.autonomy.fleets.localisation_noise import LocalisationNoise
from hil.common.errors import MissionError
from tests.support.flights.paper_hunt import FORMATIONS, TARGET

FIELDS = FieldSettings()
RING = 1.5
SEPARATION = 0.5  # 0.38 m x 0.30 m vehicles need 0.49 m from middle to middle
STEP, LAG = 0.25, 0.3


def plan_of(name: str) -> HuntPlan:
    return HuntPlan(FORMATIONS[name], TARGET, RING, FIELDS.max_speed)


class Hunt:
    """Point masses that follow the commanded velocity with a lag; each measures itself and others with noise."""

    def __init__(self, name: str, seed: int, deviation: float = 0.05, fields: FieldSettings = FIELDS) -> None:
        self.plan = plan_of(name)
        self.hunters = [Hunter(self.plan, number, fields, SEPARATION) for number in range(4)]
        self.positions = list(self.plan.starts)
        self.referee = Referee(self.plan, Criteria(SEPARATION))
        self._velocities: list[Vector] = [(0.0, 0.0)] * 4
        self._noise = LocalisationNoise(deviation, seed)

    def step(self, held_number: int = -1) -> None:
        measured_positions = [self._noise.measured(position) for position in self.positions]
        reports = [Report(here, hunter.clock) for here, hunter in zip(measured_positions, self.hunters, strict=True)]
        for k, hunter in enumerate(self.hunters):
            wanted = hunter.update(measured_positions[k], [*reports[:k], *reports[k + 1 :]], STEP)
            assert math.hypot(*wanted) <= FIELDS.max_speed + 1e-9
            north, east = (v + (w - v) * STEP / LAG for v, w in zip(self._velocities[k], wanted, strict=True))
            self._velocities[k] = (0.0, 0.0) if k == held_number else (north, east)
        self.positions = [
            (p[0] + v[0] * STEP, p[1] + v[1] * STEP) for p, v in zip(self.positions, self._velocities, strict=True)
        ]
        self.referee.watch(self.positions, max(hunter.clock for hunter in self.hunters))

    def run(self, seconds: float) -> Judgement:
        for _ in range(int(seconds / STEP)):
            self.step()
        return self.referee.judge(self.positions)


@pytest.mark.parametrize("name", FORMATIONS)
@pytest.mark.parametrize("batch", range(2))
def test_twenty_seeds_surround_the_target_without_collision(name: str, batch: int) -> None:
    for seed in range(10 * batch, 10 * batch + 10):
        hunt = Hunt(name, seed)
        outcome = hunt.run(1.3 * hunt.plan.duration + 10.0)
        assert outcome.success, (seed, outcome)
        assert outcome.separation > 3.0 * SEPARATION  # far from a collision at any time
        assert outcome.formation_error < 0.3
        assert outcome.largest_gap < math.radians(100.0)


@pytest.mark.parametrize("name", FORMATIONS)
def test_the_hunt_plan_keeps_formation_and_ends_in_an_even_ring(name: str) -> None:
    """Targets start as published, keep their formation, and end evenly round the hunted object."""
    plan = plan_of(name)
    assert [plan.position_at(k, 0.0) for k in range(4)] == list(FORMATIONS[name])
    half = [plan.position_at(k, 0.5 * plan.approach) for k in range(4)]
    shift = [(h[0] - s[0], h[1] - s[1]) for h, s in zip(half, FORMATIONS[name], strict=True)]
    assert all(s == pytest.approx(shift[0]) for s in shift)
    for number in range(401):
        places = [plan.position_at(k, plan.duration * number / 400) for k in range(4)]
        assert separation(places) > 1.3
        assert min(math.dist(place, TARGET) for place in places) > RING - 1e-9
        speeds = [math.hypot(*plan.velocity(k, plan.duration * number / 400)) for k in range(4)]
        assert max(speeds) < FIELDS.max_speed
    ends = [plan.position_at(k, plan.duration) for k in range(4)]
    assert [math.dist(end, TARGET) for end in ends] == pytest.approx([RING] * 4)
    assert separation(ends) == pytest.approx(RING * math.sqrt(2.0))


def test_all_vehicles_slow_down_for_one_that_is_held_up() -> None:
    """A vehicle stands still for 20 s: those who receive its reports, directly or through others, slow down with it."""
    hunt, free = Hunt("line", 3), Hunt("line", 3)
    for _ in range(int(20.0 / STEP)):
        hunt.step(held_number=0)
        free.step()
    clocks = [hunter.clock for hunter in hunt.hunters]
    assert max(clocks) < 0.6 * min(hunter.clock for hunter in free.hunters)
    assert clocks == sorted(clocks)  # farther along the line a report arrives later
    found = hunt.run(2.0 * hunt.plan.duration)
    assert found.success or found.failures == ("formation",), found


def test_a_vehicle_without_reports_follows_its_own_clock() -> None:
    """Reports from beyond the range, their clocks far behind, change nothing; the same from within hold it back."""
    lone_hunter, far, near = (Hunter(plan_of("diamond"), 0, FIELDS, SEPARATION) for _ in range(3))
    position = FORMATIONS["diamond"][0]
    for _ in range(20):
        wanted = lone_hunter.update(position, [], STEP)
        assert far.update(position, [Report((40.0, 40.0), 0.0)], STEP) == wanted
        near.update(position, [Report((4.5, 0.0), 0.0)], STEP)
        position = lone_hunter._plan.position_at(0, lone_hunter.clock)
    assert lone_hunter.clock == pytest.approx(20 * STEP, rel=0.1)
    assert near.clock < 0.5 * lone_hunter.clock


REPORTS = st.lists(
    st.builds(Report, st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0)), st.floats(0.0, 90.0), st.booleans()),
    max_size=4,
)


@given(st.lists(st.tuples(st.floats(-2.0, 10.0), st.floats(-2.0, 10.0), REPORTS, st.floats(0.0, 1.0)), max_size=12))
def test_any_reports_leave_clock_and_speed_within_limits(steps: list[tuple[float, float, list[Report], float]]) -> None:
    hunter = Hunter(plan_of("line"), 1, FIELDS, SEPARATION)
    for north, east, reports, dt in steps:
        before = hunter.clock
        wanted = hunter.update((north, east), reports, dt)
        assert math.hypot(*wanted) <= FIELDS.max_speed + 1e-9
        assert before <= hunter.clock <= min(before + dt, plan_of("line").duration)


def test_a_stopped_clock_holds_position() -> None:
    """The vehicle does not move when no time passes, at the end of the plan, or when a neighbour is far behind."""
    plan = plan_of("diamond")
    hunter = Hunter(plan, 2, FIELDS, SEPARATION)
    assert hunter.update(plan.starts[2], [], 0.0) == (0.0, 0.0)
    hunter.clock = plan.duration
    assert hunter.update(plan.position_at(2, plan.duration), [], STEP) == pytest.approx((0.0, 0.0), abs=1e-9)
    hunter.clock = 10.0
    late = [Report((40.0, 40.0), 0.0), Report((4.5, 1.0), 0.0)]  # the second is in range, and far behind
    assert hunter.update(plan.position_at(2, 10.0), late, STEP) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert hunter.clock == 10.0


def test_the_vehicles_turn_their_bows_to_the_target() -> None:
    plan = plan_of("diamond")
    hunter = Hunter(plan, 0, FIELDS, SEPARATION)
    north, east = Hunter(plan, 0, FIELDS, SEPARATION).update(FORMATIONS["diamond"][0], [], STEP)
    command = hunter.command(FORMATIONS["diamond"][0], math.pi / 2.0, [], STEP)
    assert (command.surge, command.sway) == pytest.approx((east, -north))
    assert command.yaw_rate == pytest.approx(math.atan2(6.0, 0.5) - math.pi / 2.0)


def test_the_referee_gives_the_figures_worked_out_by_hand() -> None:
    """The referee judges three on the ring, the fourth 0.5 m outside of it, and two of them 0.4 m apart once."""
    plan = plan_of("diamond")
    referee = Referee(plan, Criteria(SEPARATION))
    referee.watch([(0.0, 0.0), (0.0, 0.4), (3.0, 0.0), (6.0, 0.0)], plan.duration)
    ends = [(6.5, 8.0), (5.0, 9.5), (3.5, 8.0), (5.0, 6.0)]
    figures = referee.judge(ends)
    assert figures.separation == pytest.approx(0.4)
    assert figures.ring_error == pytest.approx(0.5)
    assert figures.largest_gap == pytest.approx(math.pi / 2.0)
    assert figures.spacing_error == pytest.approx(2.5 / (1.5 * math.sqrt(2.0)) - 1.0)
    assert figures.failures == ("separation", "ring")
    assert not figures.success
    one_side = referee.judge([(6.5, 8.0), (5.0, 9.5), (6.06, 9.06), (6.06, 6.94)])
    assert "gap" in one_side.failures
    assert one_side.largest_gap > math.pi  # the target is not between them


def test_two_vehicles_cannot_surround() -> None:
    with pytest.raises(MissionError, match="it takes three"):
        HuntPlan([(0.0, 0.0), (1.0, 0.0)], TARGET, RING, 0.4)
