"""The services of simulation_interfaces, each by its effect on the simulation."""

import math
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import ConfigError
from hil.slave.ros.parameters import failures_text, read_failures
from hil.slave.ros.simulation import FEATURES, MAX_STEPS, PAUSE_FEATURES
from sim.rotations import from_euler
from sim.tether import Tether, TetherKeys
from sim.vehicle.failures import Failure
from tests.unit.slave.test_vehicle_services import Vehicle, pose, vehicle

__all__ = ["vehicle"]  # the fixture

OK, UNSUPPORTED, NOT_FOUND, FAILED, ALREADY = 1, 0, 2, 4, 101


def call(vehicle: Vehicle, name: str, **request: Any) -> Any:
    return vehicle.server.call(f"/uuv1/{name}", request)


def code(response: Any) -> int:
    return int(response["result"]["result"])


def set_state(vehicle: Vehicle, state: int) -> int:
    return code(call(vehicle, "set_simulation_state", state={"state": state}))


def test_the_features_are_those_offered(vehicle: Vehicle) -> None:
    features = call(vehicle, "get_simulator_features")["features"]
    assert list(features["features"]) == sorted([*FEATURES.values(), *PAUSE_FEATURES.values()])


def test_a_state_is_given_in_the_worlds_axes_with_its_stamp(vehicle: Vehicle) -> None:
    """At N 3, E 4, 6 m deep, heading east: its surge is eastward, its sway southward, and rates turn likewise."""
    state = vehicle.simulation.state
    state.position, state.quaternion = [3.0, 4.0, 6.0], list(from_euler(0.0, 0.0, 0.5 * math.pi))
    state.nu = [0.3, 0.2, 0.1, 0.01, 0.02, 0.03]
    vehicle.loop.sample_publisher.stamps.begin(-1, 5 * NS_PER_S + 7)
    answer = call(vehicle, "get_entity_state", entity="uuv1")
    assert (code(answer), code(call(vehicle, "get_entity_state", entity="other"))) == (OK, NOT_FOUND)
    assert answer["state"]["header"] == {"stamp": {"sec": 5, "nanosec": 7}, "frame_id": "map"}
    assert answer["state"]["pose"]["position"] == {"x": 4.0, "y": 3.0, "z": -6.0}
    orientation = answer["state"]["pose"]["orientation"]
    assert orientation == pytest.approx({"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0})
    assert answer["state"]["twist"]["linear"] == pytest.approx({"x": 0.3, "y": -0.2, "z": -0.1})
    assert answer["state"]["twist"]["angular"] == pytest.approx({"x": 0.01, "y": -0.02, "z": -0.03})


def test_a_set_pose_is_read_back(vehicle: Vehicle) -> None:
    twist = {"linear": {"x": 0.3, "y": -0.2, "z": 0.1}, "angular": {"x": -0.02, "y": 0.04, "z": 0.05}}
    request = pose(3, 4, -6, 0.7, twist=twist)
    assert code(vehicle.server.call("/uuv1/set_entity_state", {"entity": "uuv1", **request})) == OK
    state = call(vehicle, "get_entity_state", entity="uuv1")["state"]
    assert state["pose"]["position"] == pytest.approx({"x": 3.0, "y": 4.0, "z": -6.0})
    assert abs(state["pose"]["orientation"]["w"]) == pytest.approx(math.cos(0.35))
    assert state["twist"] == {part: pytest.approx(values) for part, values in twist.items()}


def test_an_orientation_of_any_length_is_one(vehicle: Vehicle) -> None:
    request = pose(3, 4, -6, 0.7)
    at = request["state"]["pose"]["orientation"]
    request["state"]["pose"]["orientation"] = {axis: 10.0 * value for axis, value in at.items()}
    assert code(vehicle.server.call("/uuv1/set_entity_state", {"entity": "uuv1", **request})) == OK
    assert math.hypot(*vehicle.simulation.state.quaternion) == pytest.approx(1.0)


def test_reset_returns_the_vehicle_to_its_start(vehicle: Vehicle) -> None:
    start, name = vehicle.start, vehicle.simulation.vehicle.thrusters[0].name
    vehicle.loop.fail(Failure(name, "off"))
    assert vehicle.server.call("/uuv1/reset")["success"]
    assert (list(vehicle.simulation.failures(name)), vehicle.simulation.time_ns) == ([], 0)
    for scope, done in ((0, OK), (1, UNSUPPORTED), (2, OK), (4, UNSUPPORTED), (255, UNSUPPORTED)):
        vehicle.simulation.state.position, vehicle.simulation.state.nu = [9.0, 9.0, 9.0], [0.1] * 6
        assert code(call(vehicle, "reset_simulation", scope=scope)) == done
        moved = list(vehicle.simulation.state.position) == [start.north, start.east, start.depth]
        assert moved == (done == OK) == (list(vehicle.simulation.state.nu) == [0.0] * 6)
    assert list(vehicle.simulation.state.quaternion) == pytest.approx(from_euler(0.0, 0.0, start.heading))


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
    for steps, done in ((0, FAILED), (1, OK), (MAX_STEPS, OK), (MAX_STEPS + 1, FAILED), (2**64 - 1, FAILED)):
        before = simulation.time_ns
        assert code(call(vehicle, "step_simulation", steps=steps)) == done
        assert simulation.time_ns - before == steps * (done == OK) * loop.schedule.period_ns
    before = simulation.time_ns
    assert set_state(vehicle, 1) == OK
    loop.advance_to(now_ns() + 2 * NS_PER_S)
    assert simulation.time_ns > before


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


FAILURES = st.one_of(
    st.just({"kind": "off"}),
    st.floats(0.0, 1.0, exclude_max=True).map(lambda x: {"kind": "efficiency", "efficiency": x}),
    st.integers(1, 2200).map(lambda x: {"kind": "stuck", "pwm_us": x}),
    st.floats(0.0, 10.0, exclude_min=True).map(lambda x: {"kind": "delayed", "delay": x}),
    st.floats(0.0, 2.0, exclude_min=True).map(lambda x: {"kind": "noisy", "noise": x}),
)


@given(st.lists(FAILURES, max_size=5, unique_by=lambda keys: str(keys["kind"])))
def test_every_shown_value_can_be_set(tables: list[dict[str, Any]]) -> None:
    """The text of any list of failures can be parsed, also the longest."""
    failures = [Failure("bow", **table) for table in tables]
    assert read_failures(failures_text(failures), "bow", "failures.bow") == failures


@given(st.text(max_size=60) | st.text('kind=off,;. "0123456789efnoisy_', max_size=60))
def test_random_text_is_refused_without_other_errors(text: str) -> None:
    with suppress(ConfigError):
        found = read_failures(text, "bow", "failures.bow")
        assert read_failures(failures_text(found), "bow", "failures.bow") == found
