"""The hunt in simulated time: real dynamics, sensors and messages, several vehicles in step."""

import math
import statistics
from typing import Any

import pytest

from hil.autonomy.fleets.formation import separation
from hil.autonomy.fleets.hunting import HuntPlan
from hil.cases.hunt.simulated import SimulatedHunt
from hil.cases.hunt.watch import HuntRow, HuntWatch, shortest_paths
from hil.ros.fleet import decode_formation
from hil.scenario.config import load_scenario
from hil.scenario.fleet import hunt_plan
from sim.sensors.samples import ODOMETRY, OdometrySample
from tests.support.flights.paper_hunt import TARGET

SCENARIOS = {"line": "target_hunting", "diamond": "target_hunting_diamond"}


def hunt(name: str, **changes: object) -> tuple[SimulatedHunt, HuntWatch]:
    scenario = load_scenario(SCENARIOS[name], changes)
    watch = HuntWatch(scenario)
    return SimulatedHunt(scenario, watch), watch


def run(hunt: SimulatedHunt, seconds: float) -> None:
    while hunt.time < seconds:
        hunt.step()


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_hunt_surrounds_the_target(name: str) -> None:
    simulated, watch = hunt(name, seed=11)
    simulated.run()
    outcome = watch.result()
    assert outcome.success, outcome
    assert outcome.reason == "target surrounded"
    assert watch.judgement.separation > 1.0  # two vehicles touch at 0.48 m
    assert watch.judgement.largest_gap < math.radians(115.0)
    assert outcome.extra["least distance from the target (m)"] > 1.0
    assert 1.0 < outcome.ratio < 1.4
    assert outcome.duration < 1.4 * watch.plan.duration
    assert simulated.energy > 500.0
    assert all(planner.malformed == 0 for planner in simulated.planners)


def test_the_same_seed_gives_the_same_run() -> None:
    rows = []
    for seed in (3, 3, 4):
        simulated, watch = hunt("diamond", seed=seed)
        run(simulated, 3.0)
        rows.append(watch.rows)
    assert rows[0] == rows[1]
    assert rows[0] != rows[2]


def test_vehicles_out_of_range_do_not_receive_each_other() -> None:
    """Vehicles 3 m apart, with a range of 5 m, receive next neighbours only until the ring is smaller than that."""
    simulated, watch = hunt("line")
    run(simulated, 10.0)
    assert [planner.neighbours for planner in simulated.planners] == [
        ["uuv2"],
        ["uuv1", "uuv3"],
        ["uuv2", "uuv4"],
        ["uuv3"],
    ]
    first, second, *_ = simulated.planners
    assert first.beyond == pytest.approx(2 * first.received, abs=4)
    assert second.received == pytest.approx(2 * second.beyond, abs=4)
    assert separation(watch.rows[-1].positions) > 2.5


def test_reports_from_out_of_range_change_nothing() -> None:
    """The flight is bit for bit equal without the reports of the line's far end; without those of the next one it is
    not.
    """
    tracks = {}
    for unreceived in ("", "uuv4", "uuv2"):
        simulated, watch = hunt("line")
        first = simulated.planners[0]
        first._awaited.clear()
        receive = first.on_report

        def receive_some(node: str, *arguments: Any, receive: Any = receive, deaf: str | None = unreceived) -> None:
            if node != deaf:
                receive(node, *arguments)

        first.on_report = receive_some  # type: ignore[method-assign,assignment]
        run(simulated, 4.0)
        tracks[unreceived] = [row.positions[0] for row in watch.rows]
    assert tracks["uuv4"] == tracks[""]
    assert tracks["uuv2"] != tracks[""]


def test_reported_positions_have_independent_zero_mean_noise() -> None:
    """The noise of each axis of each vehicle has mean 0, the stated 5 cm, and no relation to any other."""
    simulated, _ = hunt("line")
    samples = {ODOMETRY: OdometrySample(0, (1.0, 2.0, 2.0), (1.0, 0.0, 0.0, 0.0), (0.0,) * 6)}
    columns: list[list[float]] = []
    for planner in simulated.planners:
        reports = []
        for step in range(3000):
            planner.command(0.1 * step, samples)
            found = decode_formation(planner.report())
            assert found is not None
            reports.append(found.position)
        columns += [[north - 1.0 for north, _, _ in reports], [east - 2.0 for _, east, _ in reports]]
    for number, errors in enumerate(columns):
        assert statistics.fmean(errors) == pytest.approx(0.0, abs=4.0 * 0.05 / math.sqrt(3000))
        assert statistics.stdev(errors) == pytest.approx(0.05, rel=0.06)
        for others in columns[:number]:
            assert abs(statistics.correlation(errors, others)) < 0.08


def test_vehicles_wait_until_all_neighbours_have_reported() -> None:
    simulated, watch = hunt("diamond")
    modem, simulated.planners[2].report = simulated.planners[2].report, lambda: b""  # type: ignore[method-assign]
    run(simulated, 5.0)
    assert [watch.rows[-1].clocks[number] for number in (0, 1, 3)] == [0.0, 0.0, 0.0]
    assert simulated.planners[0].status == "waiting for uuv3"
    moved = [math.dist(a, b) for a, b in zip(watch.rows[0].positions, watch.rows[-1].positions, strict=True)]
    assert max(moved[0], moved[1], moved[3]) < 0.5  # in place, within the localisation error
    simulated.planners[2].report = modem  # type: ignore[method-assign]
    run(simulated, 10.0)
    assert min(watch.rows[-1].clocks) > 2.0


def test_a_silent_vehicle_does_not_hold_up_the_others() -> None:
    """The last report of a silent vehicle expires after a second; the others go on without it."""
    simulated, watch = hunt("diamond")
    run(simulated, 5.0)
    simulated.planners[2].report = lambda: b""  # type: ignore[method-assign]
    run(simulated, 7.0)
    assert "uuv3" not in simulated.planners[0].neighbours
    before = watch.rows[-1].clocks[0]
    run(simulated, 12.0)
    assert watch.rows[-1].clocks[0] - before > 3.5


def test_a_vehicle_carried_away_fails_the_hunt() -> None:
    """The watch judges by true positions: one vehicle carried away is a ring with a gap, whatever its clock reports."""
    scenario = load_scenario("target_hunting_diamond")
    watch = HuntWatch(scenario)
    plan = watch.plan
    ends = [plan.position_at(number, plan.duration) for number in range(4)]
    stray = (*ends[:3], (TARGET[0] + 1.5 * (ends[3][0] - TARGET[0]), TARGET[1] + 1.5 * (ends[3][1] - TARGET[1])))
    clocks = (plan.duration,) * 4
    for second in range(7):
        watch.add_row(HuntRow(plan.duration + second, stray, clocks))
    outcome = watch.result()
    assert not outcome.success
    assert "ring" in outcome.reason
    assert (outcome.goal_error, watch.judgement.ring_error) == pytest.approx((0.75, 0.75))


def test_a_hunt_ends_at_the_time_limit() -> None:
    scenario = load_scenario("target_hunting_diamond", {"master.time_limit": 2.0})
    watch = HuntWatch(scenario)
    simulated = SimulatedHunt(scenario, watch)
    simulated.run()
    outcome = watch.result()
    assert (outcome.success, outcome.reason) == (False, "time limit")
    assert outcome.extra["ring closed after (s)"] == math.inf


def test_the_shortest_assignment_has_the_distance_worked_out_by_hand() -> None:
    """Four on a circle of 5.5 m that go straight in to 1.5 m go 4 m each; turned by 45 degrees none is nearer."""
    starts = [(5.5, 0.0), (0.0, 5.5), (-5.5, 0.0), (0.0, -5.5)]
    assert shortest_paths(HuntPlan(starts, (0.0, 0.0), 1.5, 0.4)) == pytest.approx(16.0)
    for scenario in SCENARIOS.values():
        plan = hunt_plan(load_scenario(scenario))
        places = sum(math.dist(s, plan.position_at(k, plan.duration)) for k, s in enumerate(plan.starts))
        assert shortest_paths(plan) <= places + 1e-9
