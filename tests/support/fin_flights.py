"""Flights of vehicles with fins through open water, in simulated time."""

from typing import Any

from hil.cases import simulated
from hil.master.flight import Outcome, Plan, prepare
from hil.scenario.config import DERIVED, Scenario, load_scenario
from hil.scenario.records import Master
from sim.environment.world import World, load_world

TORPEDOES = ("remus100", "lauv", "tethys", "eca_a9")
OPEN = load_world("open_water")._replace(cylinder=(), box=(), extent=(-400.0, 400.0, -400.0, 400.0))
GOALS = {"north": (100.0, 0.0), "east": (0.0, 100.0), "behind": (-100.0, 0.0)}


def fin_scenario(vehicle: str, goal: tuple[float, float] = GOALS["north"], **changes: Any) -> Scenario:
    """Return a scenario with the default keys of [master]; `changes` have _ for the dot: start_heading=1.0."""
    keys = {key.replace("_", ".", 1): value for key, value in changes.items()}
    scenario = load_scenario(
        "open_water", {"vehicle": vehicle, "slave.step": 0.01, "start.heading": 0.0, "master.goal": list(goal), **keys}
    )
    given = {key.partition("_")[2] for key in changes if key.startswith("master_")}
    derived = tuple([key for key in DERIVED if key not in given])
    master = scenario.master._replace(**{key: Master._field_defaults[key] for key in derived})
    return scenario._replace(derived=derived, master=master)


def fly_fins(scenario: Scenario, world: World = OPEN) -> tuple[Outcome, Plan, simulated.SimulatedVehicle]:
    """Return the outcome of a flight, its plan, and the vehicle at its end."""
    plan = prepare(scenario, world)
    vehicle = simulated.SimulatedVehicle(scenario, plan.world)
    outcome, _ = simulated.fly(scenario, plan, vehicle)
    return outcome, plan, vehicle
