"""The services of simulation_interfaces, each by its effect on the simulation."""

import math
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.common.clock import NS_PER_S, now_ns
from hil.slave.ros.simulation import FEATURES, MAX_STEPS, PAUSE_FEATURES
from sim.tether import Tether, TetherKeys
from tests.unit.slave.test_vehicle_services import Vehicle, pose

OK, UNSUPPORTED, NOT_FOUND, FAILED, ALREADY = 1, 0, 2, 4, 101


@pytest.fixture
def vehicle() -> Iterator[Vehicle]:
    made = Vehicle()
    yield made
    made.close()


def call(vehicle: Vehicle, name: str, **request: Any) -> Any:
    return vehicle.server.call(f"/uuv1/{name}", request)


def code(response: Any) -> int:
    return int(response["result"]["result"])


def set_state(vehicle: Vehicle, state: int) -> int:
    return code(call(vehicle, "set_simulation_state", state={"state": state}))


def test_the_features_are_those_offered(vehicle: Vehicle) -> None:
    features = call(vehicle, "get_simulator_features")["features"]
    assert list(features["features"]) == sorted([*FEATURES.values(), *PAUSE_FEATURES.values()])


def test_a_set_pose_is_read_back(vehicle: Vehicle) -> None:
    twist = {"linear": {"x": 0.3, "y": -0.2, "z": 0.1}, "angular": {"z": 0.05}}
    assert (
        code(vehicle.server.call("/uuv1/set_entity_state", {"entity": "uuv1", **pose(3, 4, -6, 0.7, twist=twist)}))
        == OK
    )
    state = call(vehicle, "get_entity_state", entity="uuv1")["state"]
    assert state["header"]["frame_id"] == "map"
    assert list(state["pose"]["position"].values()) == pytest.approx([3, 4, -6])
    orientation = state["pose"]["orientation"]
    assert abs(orientation["w"]) == pytest.approx(math.cos(0.35))
    assert list(state["twist"]["linear"].values()) == pytest.approx([0.3, -0.2, 0.1])
    assert state["twist"]["angular"]["z"] == pytest.approx(0.05)


def test_an_orientation_of_any_length_is_one(vehicle: Vehicle) -> None:
    request = pose(3, 4, -6, 0.7)
    at = request["state"]["pose"]["orientation"]
    request["state"]["pose"]["orientation"] = {axis: 10.0 * value for axis, value in at.items()}
    assert code(vehicle.server.call("/uuv1/set_entity_state", {"entity": "uuv1", **request})) == OK
    assert math.hypot(*vehicle.simulation.state.quaternion) == pytest.approx(1.0)


def test_reset_returns_the_vehicle_to_its_start(vehicle: Vehicle) -> None:
    assert code(call(vehicle, "reset_simulation")) == OK
    start = vehicle.start
    assert list(vehicle.simulation.state.position) == [start.north, start.east, start.depth]
    assert code(call(vehicle, "reset_simulation", scope=1)) == UNSUPPORTED
    assert code(call(vehicle, "reset_simulation", scope=255)) == UNSUPPORTED


def test_a_vehicle_that_is_moved_takes_its_tether_along(vehicle: Vehicle) -> None:
    simulation = vehicle.simulation
    simulation.tether = tether = Tether(TetherKeys(40.0), simulation.world, 0.0025, lambda: (simulation.state, []))
    tether.nodes = [[0.0, 0.0, 0.0]]
    vehicle.loop.set_state((9.0, 0.0, 5.0), (1.0, 0.0, 0.0, 0.0), (0.0,) * 6)
    assert tether.nodes == [], "the line is laid out again"


def test_a_paused_simulation_stops_and_steps_on_request(vehicle: Vehicle) -> None:
    loop, simulation = vehicle.loop, vehicle.simulation
    assert call(vehicle, "get_simulation_state")["state"]["state"] == 1
    assert code(call(vehicle, "step_simulation", steps=1)) == FAILED
    assert set_state(vehicle, 2) == OK
    assert set_state(vehicle, 2) == ALREADY
    assert call(vehicle, "get_simulation_state")["state"]["state"] == 2
    before = simulation.time_ns
    loop.advance_to(now_ns() + NS_PER_S)
    assert simulation.time_ns == before
    assert code(call(vehicle, "step_simulation", steps=4)) == OK
    assert simulation.time_ns - before == 4 * loop.schedule.period_ns
    assert code(call(vehicle, "step_simulation", steps=MAX_STEPS + 1)) == FAILED
    assert code(call(vehicle, "step_simulation", steps=2**64 - 1)) == FAILED
    assert set_state(vehicle, 1) == OK
    loop.advance_to(now_ns() + 2 * NS_PER_S)
    assert simulation.time_ns > before + 4 * loop.schedule.period_ns


def test_stamps_after_a_pause_are_on_the_clock(vehicle: Vehicle) -> None:
    loop, stamps = vehicle.loop, vehicle.loop.sample_publisher.stamps
    now = now_ns()
    loop.advance_to(now)
    set_state(vehicle, 2)
    then, period = loop.schedule.deadline_ns, loop.schedule.period_ns
    for _ in range(800):  # the loop goes on in time, so no step is skipped
        loop.advance_to(then)
        then += period
    assert not loop.schedule.skipped
    set_state(vehicle, 1)
    loop.advance_to(then)
    assert abs(stamps.stamp(vehicle.simulation.time_ns) - then) < 2 * period


def test_unsupported_states_are_refused(vehicle: Vehicle) -> None:
    assert [set_state(vehicle, state) for state in (0, 3, 77)] == [UNSUPPORTED] * 3
    vehicle.loop.source.keeps_step = True  # as an autopilot does
    assert set_state(vehicle, 2) == UNSUPPORTED
    features = call(vehicle, "get_simulator_features")["features"]["features"]
    assert not set(features) & set(PAUSE_FEATURES.values())


@settings(max_examples=200)
@given(st.text(max_size=40), st.integers(0, 255), st.integers(0, 2**64 - 1))
def test_any_request_gets_a_valid_reply(shared: Vehicle, text: str, number: int, steps: int) -> None:
    requests: dict[str, dict[str, Any]] = {
        "get_entity_state": {"entity": text},
        "reset_simulation": {"scope": number},
        "step_simulation": {"steps": steps},
    }
    for name, request in requests.items():
        assert code(call(shared, name, **request)) in (OK, UNSUPPORTED, NOT_FOUND, FAILED)


@pytest.fixture(scope="module")
def shared() -> Iterator[Vehicle]:
    made = Vehicle()
    yield made
    made.close()
