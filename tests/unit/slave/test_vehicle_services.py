"""Services of the vehicle, each judged by its effect on the vehicle."""

import hashlib
import json
import math
import select
from collections.abc import Iterator
from itertools import product
from typing import Any

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.common.clock import now_ns
from hil.network.services import Answer
from hil.recording.stamps import Stamps
from hil.ros import dialect
from hil.ros import message as ros_message
from hil.ros.graph import plain_name
from hil.ros.topics import hash_of
from hil.scenario.config import load_scenario
from hil.slave.command_receiver import CommandReceiver
from hil.slave.drivers.driver import open_driver
from hil.slave.loop import Loop
from hil.slave.pilot import build_pilot
from hil.slave.pilot_source import PilotSource
from hil.slave.ros import services
from sim.environment.world import load_world
from sim.rotations import to_euler
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle
from tests.support.links.link_contract import PATIENCE_S
from tests.support.processes import ROOT

STEP_NS = 2_500_000
STANDS_NS = 10**12  # for the pilot no time passes: a command holds for as long as its test takes
VEHICLES = sorted(path.stem for path in (ROOT / "sim" / "vehicles").glob("*.toml"))


class SilentSamplePublisher:
    """A publisher without subscribers."""

    def __init__(self) -> None:
        self.stamps = Stamps(0, 0)

    def publish_sample(self, topic: str, sample: Any) -> bool:
        return False

    def publish(self, name: str, payload: bytes) -> None:
        """Do nothing: nobody listens."""

    def wake_publisher(self) -> None:
        """Do nothing, because there is nothing to send."""


class RecordedServer:
    """A server that stores the offered services."""

    def __init__(self) -> None:
        self.offered: dict[str, tuple[str, Answer]] = {}

    def offer(self, name: str, type_name: str, handler: Answer) -> None:
        self.offered[name] = type_name, handler

    def call(self, name: str, request: Any = None) -> Any:
        """Return the response; request and response are encoded and decoded in between."""
        type_name, handler = self.offered[name]
        request_type, response_type = f"{type_name}_Request", f"{type_name}_Response"
        requested = ros_message.decode(request_type, ros_message.encode(request_type, request or {}))
        assert requested is not None
        return ros_message.decode(response_type, ros_message.encode(response_type, handler(requested)))


class Vehicle:
    """A vehicle with a real loop, stepped by hand."""

    def __init__(self) -> None:
        scenario = load_scenario("paper_field")
        vehicle, control = load_vehicle(scenario.vehicle)
        world = load_world(scenario.world)
        self.start = scenario.start
        self.simulation = Simulation(vehicle, world, dt_ns=STEP_NS, position=(0.0, 0.0, 5.0))
        pilot = build_pilot(scenario, vehicle, control, world)
        driver = open_driver("python", scenario.link, len(vehicle.channels), True, 1, print)
        self.command_receiver = CommandReceiver(10**9, 10**9, 1000.0)
        publisher: Any = SilentSamplePublisher()
        source = PilotSource(pilot, driver, self.command_receiver, 20_000_000, STEP_NS, print, print)
        self.pilot, self.loop = pilot, Loop(self.simulation, driver, source, publisher, STEP_NS, print)
        self.server, self.output = RecordedServer(), list[str]()
        offered: Any = self.server
        services.offer_services(offered, "uuv1", self.loop, self.start, self.output.append)

    def command(self, surge: float) -> None:
        self.pilot.set_command(VelocityCommand(surge=surge), STANDS_NS)

    def run(self, steps: int) -> None:
        """Run steps as the loop does, with as many updates of the controller."""
        for _ in range(steps):
            command, _ = self.pilot.update(STANDS_NS, 0.0025)
            self.loop.driver.send(command)
            while not (self.loop.driver.newest and self.loop.driver.newest.sequence == command.sequence):
                assert select.select(self.loop.driver.descriptors, (), (), PATIENCE_S)[0], "the STM32 is silent"
                self.loop.service_link(now_ns())
            self.loop.advance(1)

    def close(self) -> None:
        self.loop.driver.close()
        self.command_receiver.close()


@pytest.fixture
def vehicle() -> Iterator[Vehicle]:
    made = Vehicle()
    yield made
    made.close()


def pose(x: float, y: float, z: float, yaw: float = 0.0, **fields: Any) -> dict[str, Any]:
    """Return a request of set_pose, ENU."""
    orientation = {"z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}
    return {"state": {"pose": {"position": {"x": x, "y": y, "z": z}, "orientation": orientation}, **fields}}


def test_the_offered_services_are_complete(vehicle: Vehicle) -> None:
    expected = {"arm": "std_srvs/srv/SetBool", "reset": "std_srvs/srv/Trigger"}
    expected["set_pose"] = "simulation_interfaces/srv/SetEntityState"
    expected |= {f"thrusters/{one.name}/fail": expected["arm"] for one in vehicle.simulation.vehicle.thrusters}
    for package, names in {
        "simulation_interfaces": "get_simulator_features reset_simulation get_entity_state set_entity_state "
        "get_simulation_state set_simulation_state step_simulation",
        "rcl_interfaces": "list_parameters get_parameters get_parameter_types describe_parameters set_parameters "
        "set_parameters_atomically",
        "type_description_interfaces": "get_type_description",
    }.items():
        expected |= {name: f"{package}/srv/{name.title().replace('_', '')}" for name in names.split()}
    offered = {name.removeprefix("/uuv1/"): type_name for name, (type_name, _) in vehicle.server.offered.items()}
    assert offered == expected


def test_types_are_described_as_their_hash_says(vehicle: Vehicle) -> None:
    """The hash of a type is that of its description, REP 2016."""
    for name in ("sensor_msgs/msg/Imu", "std_srvs/srv/SetBool", "type_description_interfaces/srv/GetTypeDescription"):
        request = {"type_name": name, "type_hash": hash_of(name)}
        response = vehicle.server.call("/uuv1/get_type_description", request)
        assert response["successful"], response
        text = json.dumps(response["type_description"]).replace(', "default_value": ""', "")  # which no hash contains
        assert f"RIHS01_{hashlib.sha256(text.encode()).hexdigest()}" == hash_of(name)
        described = {part["type_name"] for part in response["type_description"]["referenced_type_descriptions"]}
        assert {source["type_name"] for source in response["type_sources"]} <= {name, *described}
        assert all(source["raw_file_contents"] for source in response["type_sources"])
    wrong = {"type_name": "sensor_msgs/msg/Imu", "type_hash": hash_of("sensor_msgs/msg/Image")}
    for request, reason in (
        (wrong, "has the hash RIHS01_7d9a"),
        ({"type_name": "a/msg/B"}, "no message type 'a/msg/B'"),
    ):
        response = vehicle.server.call("/uuv1/get_type_description", request)
        assert not response["successful"]
        assert reason in response["failure_reason"]


def test_from_lyrical_on_pose_and_velocity_are_set_apart(vehicle: Vehicle) -> None:
    """simulation_interfaces 2.1: what is not to be set is not even read."""
    dialect.select(0, "lyrical")
    state, nothing = vehicle.simulation.state, {"orientation": {"w": 0.0}}
    moved = {**pose(3.0, 2.0, -4.0), "set_pose": True}
    assert vehicle.server.call("/uuv1/set_pose", moved)["result"]["result"] == 1
    assert [*vehicle.simulation.state.position] == [2.0, 3.0, 4.0]
    assert [*vehicle.simulation.state.nu] == [*state.nu]
    request = {"state": {"pose": nothing, "twist": {"linear": {"x": 0.5}}}, "set_twist": True}
    assert vehicle.server.call("/uuv1/set_pose", request)["result"]["result"] == 1
    assert [*vehicle.simulation.state.position] == [2.0, 3.0, 4.0]
    assert vehicle.simulation.state.nu[0] == pytest.approx(0.5)
    assert vehicle.server.call("/uuv1/set_pose", {**request, "set_pose": True})["result"]["result"] == 101


def test_disarming_sets_neutral_and_refuses_commands(vehicle: Vehicle) -> None:
    loop = vehicle.loop
    vehicle.command(0.8)
    vehicle.run(200)
    assert max(vehicle.simulation.thrusts) > 1.0
    assert vehicle.server.call("/uuv1/arm", {"data": False})["success"]
    vehicle.run(20)
    assert set(loop.driver.pwm_us) == {1500}
    loop.serve_source(now_ns())
    assert not loop.source.armed
    assert vehicle.server.call("/uuv1/arm", {"data": True})["success"]
    assert loop.source.armed
    vehicle.command(0.8)
    vehicle.run(20)
    assert set(loop.driver.pwm_us) != {1500}


def test_a_thruster_fails_and_is_repaired(vehicle: Vehicle) -> None:
    name = vehicle.simulation.vehicle.thrusters[0].name
    vehicle.command(0.8)
    vehicle.run(200)
    assert abs(vehicle.simulation.thrusts[0]) > 0.5
    assert vehicle.server.call(f"/uuv1/thrusters/{name}/fail", {"data": True}) == {
        "success": True,
        "message": f"{name} is off",
    }
    vehicle.run(400)
    assert vehicle.simulation.thrusts[0] == pytest.approx(0.0, abs=0.05)
    assert max(map(abs, vehicle.simulation.thrusts[1:])) > 0.5
    vehicle.server.call(f"/uuv1/thrusters/{name}/fail", {"data": False})
    vehicle.run(400)
    assert abs(vehicle.simulation.thrusts[0]) > 0.5
    assert vehicle.output == [f"thruster: {name} is off", f"thruster: {name} is repaired"]


@pytest.mark.parametrize("name", ["a", "upper starboard fin", "7", "ü-1", "T_1"])
def test_thruster_names_are_valid_ros_names(name: str) -> None:
    plain = plain_name(name)
    assert plain.isidentifier()
    assert plain.isascii()


def test_set_pose_accepts_enu_and_a_velocity_in_world_axes(vehicle: Vehicle) -> None:
    request = pose(3.0, 1.0, -4.0, yaw=math.pi / 2, twist={"linear": {"y": 0.7, "z": 0.1}, "angular": {"z": 0.2}})
    assert vehicle.server.call("/uuv1/set_pose", request) == {"result": {"result": 1, "error_message": ""}}
    state = vehicle.simulation.state
    assert list(state.position) == [1.0, 3.0, 4.0]
    assert to_euler(state.quaternion) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)  # to the north
    assert state.nu == pytest.approx([0.7, 0.0, -0.1, 0.0, 0.0, -0.2], abs=1e-12)
    vehicle.run(40)
    assert vehicle.simulation.state.position[0] > 1.02


@pytest.mark.parametrize("name", VEHICLES)
def test_the_fastest_motion_of_set_pose_stays_stable(name: str) -> None:
    """The motion stays bounded at full thrust, about any axis and along any other, also with long steps."""
    vehicle, _ = load_vehicle(name)
    directions = [[sign * (axis == i) for i in range(3)] for axis in range(3) for sign in (1.0, -1.0)]
    for step_ns in (STEP_NS, 20_000_000):
        most = services._MAX_PATH * 1e9 / step_ns
        for linear, angular in product(directions, directions):
            simulation = Simulation(vehicle, load_world("pool"), sensors={}, dt_ns=step_ns, position=(5.0, 5.0, 2.0))
            simulation.state.nu = [most * x for x in linear + angular]
            for _ in range(40):
                simulation.step((1900,) * len(vehicle.channels))
            assert max(map(abs, simulation.state.nu)) < 20.0 * most, (step_ns, linear, angular)


@pytest.mark.parametrize(
    ("request_", "code", "message"),
    [
        (pose(0.0, 0.0, -400.0), 101, "an obstacle or the seabed of paper_field is there"),
        (pose(math.nan, 0.0, -4.0), 101, "a place is not finite"),
        (pose(1.1e6, 0.0, -4.0), 101, "more than 1e+06 m away"),
        (pose(0.0, 0.0, -4.0, twist={"linear": {"x": 1e160}}), 101, "a velocity is not finite, or more than 10 m/s"),
        (pose(0.0, 0.0, -4.0, twist={"angular": {"y": 8.0, "z": 8.0}}), 101, "or more than 10 m/s or rad/s"),
        (pose(0.0, 0.0, -4.0, twist={"angular": {"x": math.nan}}), 101, "a velocity is not finite"),
        (pose(0.0, 0.0, -4.0) | {"entity": "uuv2"}, 2, "no entity 'uuv2'; there is: uuv1"),
        ({"state": {"pose": {"orientation": {"w": 0.0}}}}, 101, "orientation is none"),
        ({"state": {"header": {"frame_id": "odom2"}}}, 4, "frame 'odom2' is not known"),
    ],
)
def test_invalid_requests_are_refused_with_a_reason(vehicle: Vehicle, request_: Any, code: int, message: str) -> None:
    before = list(vehicle.simulation.state.position)
    result = vehicle.server.call("/uuv1/set_pose", request_)["result"]
    assert result["result"] == code
    assert message in result["error_message"]
    assert list(vehicle.simulation.state.position) == before
    assert vehicle.output == []
