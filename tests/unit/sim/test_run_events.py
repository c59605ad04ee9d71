"""Events of a run: detected from positions, attitudes and contacts alone, merged, counted, recorded."""

from math import cos, hypot, pi, radians, sin
from typing import Any

import pytest

from hil.common.errors import DivergenceError
from sim.environment.obstacles import Box, Cylinder
from sim.environment.world import World
from sim.run_events import (
    MAX_EVENTS,
    EventLog,
    RunEvent,
    RunMonitor,
    decode_events,
    encode_events,
    events_since,
    merge_events,
)
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle, mass_matrix

S = 1_000_000_000
TICK = S // 20
LEVEL = (1.0, 0.0, 0.0, 0.0)
SIX = load_vehicle("paper_six")[0]


def tilted(degrees: float) -> tuple[float, float, float, float]:
    return cos(radians(degrees) / 2), 0.6 * sin(radians(degrees) / 2), 0.8 * sin(radians(degrees) / 2), 0.0


def monitor(tilt: float = pi / 3) -> RunMonitor:
    return RunMonitor(EventLog(), tilt, half_height=0.2, margin=1.0)


def dive(judge: RunMonitor, *depths: float, requested: float | None = None) -> list[RunEvent]:
    """Return the events of a dive that is observed every 50 ms."""
    for number, depth in enumerate(depths):
        judge.observe(number * TICK, (1.0, 2.0, depth), LEVEL, requested)
    return list(judge.log.events())


def test_a_lasting_condition_is_one_event() -> None:
    log = EventLog()
    for step in range(100):  # in touch every other step, as a hull that slides along a wall
        log.record("collision", step * TICK, step * TICK + TICK // 2, (step, 0.0, 5.0), "the wall")
    assert log.events() == (RunEvent("collision", 0, 99 * TICK + TICK // 2, (0, 0.0, 5.0), "the wall"),)
    log.record("collision", 100 * TICK, 101 * TICK, (7.0, 0.0, 5.0), "the pile")
    log.record("collision", 1000 * TICK, 1001 * TICK, (8.0, 0.0, 5.0), "the wall")
    assert [event.what for event in log.events()] == ["the wall", "the pile", "the wall"]


def test_an_event_log_is_bounded_and_counts_dropped_events() -> None:
    log = EventLog()
    for number in range(MAX_EVENTS + 3):
        log.record("capsize", 10 * number * S, 10 * number * S, (0.0, 0.0, 0.0))
    assert (len(log), log.dropped) == (MAX_EVENTS, 3)


@pytest.mark.parametrize(("degrees", "capsized"), [(0, False), (59, False), (61, True), (-61, True), (180, True)])
def test_a_vehicle_that_is_tilted_too_far_has_capsized(degrees: float, capsized: bool) -> None:
    judge = monitor()
    judge.observe(0, (0.0, 0.0, 5.0), tilted(degrees), 5.0)
    assert [event.kind for event in judge.log.events()] == (["capsize"] if capsized else [])
    lenient = monitor(tilt=3.2)
    lenient.observe(0, (0.0, 0.0, 5.0), tilted(degrees), 5.0)
    assert not lenient.log.events()


def test_a_vehicle_at_the_surface_below_its_commanded_depth_has_surfaced() -> None:
    up = dive(monitor(), 5.0, 3.0, 0.21, 0.19, 0.1, 3.0, requested=5.0)
    assert [(event.kind, event.start_ns, event.duration_ns) for event in up] == [("surfaced", 3 * TICK, TICK)]
    assert up[0].position == (1.0, 2.0, 0.19)


def test_a_vehicle_that_sinks_is_too_deep() -> None:
    down = dive(monitor(), 5.0, 6.0, 6.1, 8.0, requested=4.0)
    assert [(event.kind, event.start_ns) for event in down] == [("too_deep", 2 * TICK)]
    assert not dive(monitor(), 5.0, 7.9, requested=7.0)
    assert not dive(monitor(), 5.0, 0.1, requested=0.1)


def test_events_survive_a_round_trip_and_malformed_ones_are_refused() -> None:
    events = (
        RunEvent("collision", 5 * S, S, (1.5, -2.25, 3.125), "the pile at (1, 2)"),
        RunEvent("capsize", 7 * S, 0, (0.0, 0.0, 5.0)),
    )
    assert decode_events(encode_events(events)) == events
    assert events[0].describe().endswith("(1, 2) 5.0 s after the start, for 1.0 s, at N 1.5 E -2.2 depth 3.1 m")
    assert events[1].describe() == "capsize 7.0 s after the start, for less than 0.1 s, at N 0.0 E 0.0 depth 5.0 m"
    assert decode_events(encode_events([events[0]._replace(what="a\nsea\tmine ")]))[0].what == "a sea mine"
    numbers = "1 -2 3 4 5", "1 2 nan 4 5", "1 2 3 inf 5", "1 2 3 4 inf"
    rubbish = "", "collision", "collision 1 2 3 4", "eaten 1 2 3 4 5 x", *(f"capsize {each}" for each in numbers)
    assert decode_events("\n".join(rubbish)) == ()


def test_events_of_a_run_are_those_after_its_start() -> None:
    before = RunEvent("collision", 0, S, (0.0, 0.0, 5.0), "x")
    across = before._replace(start_ns=5 * S, duration_ns=10 * S)
    until, after = before._replace(duration_ns=10 * S), before._replace(start_ns=12 * S)
    shifted = events_since([before, across, until, after], 10 * S)
    assert [(event.start_ns, event.duration_ns) for event in shifted] == [(0, 5 * S), (0, 0), (2 * S, S)]


def test_events_of_the_first_observer_take_precedence() -> None:
    exact = RunEvent("capsize", 5 * S, S, (0.0, 0.0, 5.0))
    coarse = exact._replace(start_ns=exact.start_ns + TICK, duration_ns=S // 2)
    later, other = exact._replace(start_ns=20 * S), exact._replace(kind="surfaced")
    assert merge_events([exact], [other, later, coarse]) == (exact, other, later)


def sliding(**world: Any) -> Simulation:
    """Return a run ahead for 15 s against a pile that the reference vehicle hits off its middle and slides along."""
    place = World("some", "made up", (-20.0, 20.0, -20.0, 20.0), 10.0)._replace(**world)
    simulation = Simulation(SIX, place, {}, position=(0.0, 0.0, 5.0), dt_ns=5_000_000)
    for _ in range(15 * 200):
        simulation.step((1600, 1600, 1500, 1500, 1500, 1500))
    return simulation


def test_a_collision_names_the_obstacle_and_position() -> None:
    (event, *_) = sliding(cylinder=(Cylinder(4.0, 0.2, 0.5, name="the north buoy"),)).events.events()
    assert (event.kind, event.what) == ("collision", "the north buoy")
    assert event.position[0] == pytest.approx(3.5 - hypot(*SIX.dimensions[:2]) / 2, abs=0.1)
    assert event.start_ns > S
    assert "collision with the north buoy" in event.describe()
    assert "the pile at (4, 0.2)" in sliding(cylinder=(Cylinder(4.0, 0.2, 0.5),)).events.events()[0].describe()
    assert sliding(box=(Box(6.0, 0.0, 1.0, 9.0),)).events.events()[0].what == "the block at (6, 0)"
    assert sliding(extent=(-4.0, 4.0, -4.0, 4.0), walls=True).events.events()[0].what == "the north wall"
    assert not sliding().events.events()


def test_each_contact_is_recorded_to_the_step() -> None:
    """A contact of one step is an event of one step; lying on the seabed is one event while it lasts."""
    world = World("some", "made up", (-20.0, 20.0, -20.0, 20.0), 10.0)
    simulation = Simulation(SIX, world, {}, position=(0.0, 0.0, 10.0 - 0.5 * SIX.dimensions[2] - 1e-4))
    simulation.state.nu = [0.0, 0.0, 0.1, 0.0, 0.0, 0.0]
    reported, pushes = [], list[float]()
    for _ in range(400):
        before = simulation.state.nu
        simulation.step((1500,) * 6)
        forces = simulation.forces()
        assert any(forces.contact) == simulation.touching
        assert forces.total == pytest.approx([sum(terms) for terms in zip(*forces[:-1], strict=True)])
        if simulation.touching:
            reported.append(simulation.time_ns)
            change = [new - old for new, old in zip(simulation.state.nu, before, strict=True)]
            assert simulation.state.nu_dot == pytest.approx([x / 2.5e-3 for x in change])
            pushes.append(-forces.contact[2] * 2.5e-3)  # N s
    (event,) = simulation.events.events()
    assert event.what == "the seabed"
    assert event.end_ns == reported[-1]
    assert event.start_ns == reported[0] - 2_500_000
    assert pushes[0] == pytest.approx(0.1 * mass_matrix(SIX)[2][2], rel=0.5)
    simulation.place((0.0, 0.0, 9.0), LEVEL, (0.0, 0.0, -1e100, 0.0, 0.0, 0.0))  # damping turns it around, downwards
    with pytest.raises(DivergenceError):
        simulation.step((1500,) * 6)


def test_new_events_are_returned_once() -> None:
    log = EventLog()
    log.record("collision", 0, 0, (0.0, 0.0, 1.0), "a pile")
    log.record("surfaced", 10, 10, (0.0, 0.0, 0.0))
    assert [event.kind for event in log.new_events()] == ["collision", "surfaced"]
    log.record("surfaced", 20, 20, (0.0, 0.0, 0.0))
    assert log.new_events() == [], "it goes on"
