"""A slave is paused, stepped and resumed by the services of simulation_interfaces, as a client of ROS 2 does it."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hil.network.roles import open_master_session
from hil.network.services import call
from hil.network.session import Session
from hil.ros import message as ros_message
from tests.support.processes import Program, wait_for, write_scenario

PACKAGE = "simulation_interfaces/srv/"
PLAYING, PAUSED = 1, 2
STEP_NS = 10_000_000


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    scenario, port = write_scenario(tmp_path)
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("ready")
        with open_master_session(f"tcp/127.0.0.1:{port}") as session:
            yield session


def ask(session: Session, name: str, kind: str, **request: Any) -> Any:
    return call(session, f"/uuv1/{name}", f"{PACKAGE}{kind}", request, 20.0)


def simulated_ns(session: Session) -> int:
    """Return the stamp of the vehicle's state."""
    state = ask(session, "get_entity_state", "GetEntityState", entity="uuv1")["state"]
    return ros_message.time_of(state)


def test_simulated_time_stops_steps_and_continues(session: Session) -> None:
    clocks: list[int] = []

    def deliver(_key: str, payload: bytes, _attachment: bytes) -> None:
        message = ros_message.decode("rosgraph_msgs/msg/Clock", payload)
        assert message
        clocks.append(message["clock"]["sec"] * 10**9 + message["clock"]["nanosec"])

    session.subscribe_keys("0/clock/*/*", deliver, 10)
    assert wait_for(lambda: len(clocks) > 3)
    state = {"state": {"state": PAUSED}}
    assert ask(session, "set_simulation_state", "SetSimulationState", **state)["result"]["result"] == 1
    before = simulated_ns(session)
    time.sleep(0.3)
    assert simulated_ns(session) == before
    assert ask(session, "step_simulation", "StepSimulation", steps=10)["result"]["result"] == 1
    assert simulated_ns(session) == before + 10 * STEP_NS
    received = len(clocks)
    assert ask(session, "set_simulation_state", "SetSimulationState", state={"state": PLAYING})["result"]["result"] == 1
    assert wait_for(lambda: len(clocks) > received + 3)
    assert clocks == sorted(clocks)  # time never goes back
    assert abs(simulated_ns(session) - time.time_ns()) < 20 * 10**9
    assert simulated_ns(session) > before + 300_000_000
