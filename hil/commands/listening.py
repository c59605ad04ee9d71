"""Find the endpoints that a command connects to, and the scenario if one is given."""

from typing import Any

from hil.common.options import LOCAL_SLAVE, changes_of
from hil.scenario.config import Scenario, load_scenario, load_single


def scenario_and_endpoints(options: Any) -> tuple[Scenario | None, list[str]]:
    """Return the scenario of `add_settings`, and the endpoints of `add_connect`: else the scenario's, else one here.

    A scenario with a router is reached there. Raises ConfigError, also for a fleet with neither a router nor `connect`:
    each of its vehicles has an endpoint of its own.
    """
    name, connect = options.scenario, options.connect
    if name is None:
        return None, connect or [LOCAL_SLAVE]
    scenario = load_scenario(name, changes_of(options))
    if connect:
        return scenario, connect
    if scenario.network.router:
        return scenario, [scenario.network.router]
    if scenario.member:
        ends = " ".join([f"--connect {member.listen}" for member in scenario.member])
        load_single(name, remedy=f"and each vehicle has an endpoint of its own: name those to listen to, {ends}")
    return scenario, [scenario.slave.listen]
