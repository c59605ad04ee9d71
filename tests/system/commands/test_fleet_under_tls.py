"""Slaves and planners of a fleet hunt with TLS, each with its own key."""

import signal
from contextlib import ExitStack
from pathlib import Path

from hil.cases.target_hunting import members_on_free_ports
from hil.commands.keys import add_machine
from hil.scenario.config import load_scenario
from hil.scenario.variant import write_variant
from tests.support.network.fleet_keys import PLANNERS, keys
from tests.support.processes import Program, free_port

__all__ = ["keys"]  # the fixture


def hunt(scenario: str, keys: Path, vehicles: list[str], folder: Path) -> list[int]:
    """Start a slave and a planner for each member, with these keys; return the reports that each planner received."""
    with ExitStack() as stack:
        agents = []
        for member, vehicle, planner in zip(load_scenario(scenario).member, vehicles, PLANNERS, strict=True):
            own = "--set", f'security.slave="{keys / vehicle}"', "--set", f'security.master="{keys / planner}"'
            stack.enter_context(Program(folder, "slave", scenario, "--member", member.node, *own))
            agents.append(
                stack.enter_context(Program(folder, "fleet", "agent", scenario, "--member", member.node, *own))
            )
        for agent in agents:
            agent.expect(r"[1-9]\d*% of the plan")
        for agent in agents:
            agent.process.send_signal(signal.SIGINT)
        return [int(agent.expect(r"reports: (\d+) received")[1]) for agent in agents]


def test_a_fleet_with_separate_keys_hunts_with_tls(keys: Path, tmp_path: Path) -> None:
    vehicles = [f"vehicle{number}" for number in (1, 2, 3)]
    for name in vehicles:
        add_machine(str(keys), name, ["localhost"])
    changes = {
        "member": members_on_free_ports("target_hunting")[:3],
        "security.slave": str(keys / "uuv"),
        "security.master": str(keys / PLANNERS[0]),
        "security.may_command": list(PLANNERS),
    }
    scenario = write_variant("target_hunting", str(tmp_path), changes)
    assert min(hunt(scenario, keys, vehicles, tmp_path)) > 0


def test_a_fleet_with_tls_hunts_behind_a_router(keys: Path, tmp_path: Path) -> None:
    """Each vehicle has its own key, which the router accepts by `vehicles`."""
    vehicles = [f"behind{number}" for number in (1, 2, 3)]
    for name in (*vehicles, "hub"):
        add_machine(str(keys), name, ["localhost"])
    router = f"tcp/127.0.0.1:{free_port()}"
    changes = {
        "member": members_on_free_ports("target_hunting")[:3],
        "network.mode": "routed",
        "network.router": router,
        "security.slave": str(keys / vehicles[0]),
        "security.vehicles": vehicles[1:],
        "security.master": str(keys / PLANNERS[0]),
        "security.router": str(keys / "hub"),
        "security.may_command": list(PLANNERS),
    }
    scenario = write_variant("target_hunting", str(tmp_path), changes)
    with Program(tmp_path, "router", "--scenario", scenario, "--listen", router) as hub:
        hub.expect("forwarding")
        assert min(hunt(scenario, keys, vehicles, tmp_path)) > 0
