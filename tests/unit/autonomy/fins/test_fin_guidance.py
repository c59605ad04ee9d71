"""Guidance of vehicles with fins: turning circles, flights with default keys, and keys that do not fit."""

from math import hypot, pi
from typing import Any

import pytest

from hil.autonomy.control.controller import VelocityCommand, gains_of
from hil.autonomy.control.fin_control import FinGains
from hil.common.schema import parse
from hil.doctor.scenario.check import check_scenario
from hil.master.flight import make_request
from hil.master.manoeuvring import Manoeuvring
from hil.scenario.config import build_simulation
from hil.slave.pilot import build_pilot
from sim.environment.obstacles import Cylinder
from sim.sensors.samples import GROUND_TRUTH
from sim.vehicle.vehicle import load_vehicle
from tests.support.fin_flights import GOALS, OPEN, TORPEDOES, fin_scenario, fly_fins

SPEEDS = {"remus100": 1.5, "lauv": 1.2, "tethys": 0.7, "eca_a9": 1.5}
TASK = {"name": "a", "at": [0.0, 90.0], "duration": 5.0}


def simulated_radius(name: str, speed: float) -> float:
    """Return the radius (m) of a circle with the greatest turn rate, after 70 s of turning."""
    scenario, (vehicle, control) = fin_scenario(name), load_vehicle(name)
    simulation, pilot = build_simulation(scenario, vehicle, OPEN), build_pilot(scenario, vehicle, control, OPEN)
    command = VelocityCommand(surge=speed, yaw_rate=3.0, depth=5.0)
    for step in range(7_000):
        if step % 2 == 0:
            pilot.set_command(command, simulation.time_ns)
            pulses, _ = pilot.update(simulation.time_ns, 0.02)
        for topic, sample in simulation.step(pulses.pwm_us):
            if topic != GROUND_TRUTH:
                pilot.update_sensor(topic, sample)
    u, v, *_, r = simulation.state.nu
    return hypot(u, v) / abs(r)


@pytest.mark.parametrize("name", TORPEDOES)
def test_the_turning_radius_is_that_of_simulated_circles(name: str) -> None:
    vehicle, control = load_vehicle(name)
    gains, fins = gains_of(control, name), parse(control["fins"], FinGains, name)
    computed = Manoeuvring(vehicle, gains, fins, SPEEDS[name], OPEN.density).turn_radius()
    assert computed == pytest.approx(simulated_radius(name, SPEEDS[name]), rel=0.03)


def test_a_slope_is_limited_by_pitch_and_by_the_righting_moment() -> None:
    """At its least speed the planes of remus100 hold 313 N at 2 cm against 4 degrees; faster, the pitch limit holds."""
    vehicle, control = load_vehicle("remus100")
    gains, fins = gains_of(control, ""), parse(control["fins"], FinGains, "")
    slow, fast = (Manoeuvring(vehicle, gains, fins, speed, OPEN.density).slope() for speed in (0.7, 2.0))
    assert 0.03 < slow < 0.12 < 0.25 < fast < fins.pitch_limit


@pytest.mark.parametrize(
    ("name", "goal", "heading", "current"),
    [
        ("remus100", "east", 0.0, (0.0, 0.0, 0.0)),
        ("lauv", "behind", pi / 2.0, (0.3, 0.0, 0.0)),
    ],
)
def test_goals_are_reached_with_default_keys(name: str, goal: str, heading: float, current: Any) -> None:
    scenario = fin_scenario(name, GOALS[goal], start_heading=heading)
    outcome, plan, vehicle = fly_fins(scenario, OPEN._replace(current=current))
    assert outcome.success, outcome.verdict
    assert outcome.goal_error <= plan.request.master.tolerance
    assert vehicle.simulation.state.position[2] == pytest.approx(10.0, abs=0.3)


def test_a_dive_follows_the_slope_of_the_path() -> None:
    """25 m of depth need more than the 60 m to the goal: the vehicle circles, and is deep when it arrives."""
    outcome, _, vehicle = fly_fins(fin_scenario("lauv", (60.0, 0.0), master_depth=25.0))
    assert outcome.success, outcome.verdict
    assert outcome.path_length > 1.5 * 60.0
    assert vehicle.simulation.state.position[2] == pytest.approx(25.0, abs=0.5)


def test_given_keys_are_respected_and_others_derived() -> None:
    vehicle, _ = load_vehicle("remus100")
    derived = make_request(fin_scenario("remus100"), vehicle, OPEN)
    given = make_request(fin_scenario("remus100", master_lookahead=5.0, master_speed=1.0), vehicle, OPEN)
    assert derived.master.lookahead >= derived.limits.turn_radius * 0.99 > 10.0
    assert 0.7 < derived.master.speed < 2.5
    assert (given.master.lookahead, given.master.speed) == (5.0, 1.0)
    assert given.master.tolerance > 1.0
    pile = OPEN._replace(cylinder=(Cylinder(106.0, 0.0, 3.0, 0.0, False, bottom=30.0),))
    near = make_request(fin_scenario("remus100"), vehicle, pile)
    assert near.clearance < 3.0 < derived.clearance  # the goal is 3 m from the pile
    six, _ = load_vehicle("paper_six")
    hovering = make_request(fin_scenario("paper_six"), six, OPEN)
    assert hovering.limits.turn_radius == 0.0
    assert (hovering.master.lookahead, hovering.master.speed) == (1.5, 0.5)


@pytest.mark.parametrize(
    ("changes", "texts"),
    [
        (
            {"master_lookahead": 1.5, "master_tolerance": 0.3},
            ["lookahead: 1.5 m, but remus100 turns in circles of", "tolerance: 0.3 m, but remus100 turns in circles"],
        ),
        ({"master_speed": 0.4}, ["speed: 0.4 m/s, but remus100 goes at a higher", "depth: remus100 changes its"]),
        (
            {"master_goal": (0.0, 9.0), "master_depth": 28.0, "master_time_limit": 50.0},
            ["time_limit: the path of", "goal: 9.0 m away, but remus100 turns in circles of",
             "depth: remus100 changes its depth by at most"],
        ),
        (
            {"planner": {"class": "hil.master.tasks:Tasks", "home": [0.0, 0.0], "task": [TASK]}},
            ["Tasks holds a place"],
        ),
        ({"planner": {"class": "hil.master.avoid:Avoid"}}, ["Avoid stops in front of obstacles"]),
        ({}, []),
    ],
)  # fmt: skip
def test_a_check_warns_of_keys_that_do_not_fit(changes: dict[str, Any], texts: list[str]) -> None:
    goal = changes.pop("master_goal", (0.0, 100.0))
    findings = [finding.text for finding in check_scenario(fin_scenario("remus100", goal, **changes))]
    findings = [finding for finding in findings if "needs the topic" not in finding]
    assert len(findings) == len(texts), findings
    assert all(text in finding for text, finding in zip(texts, findings, strict=True)), findings
