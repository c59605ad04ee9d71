"""`uuv-hil topic` as a user runs it, and how it writes and reads messages."""

import json
import math
import re
import signal
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from hil.client.message_text import lines, parse_values
from hil.client.topics import whole_type
from hil.commands.topic import listing
from hil.common.errors import ConfigError
from hil.network.opening import listen
from hil.ros import graph, types
from hil.ros import message as ros_message
from hil.ros.graph import Entity
from hil.ros.topics import Qos
from tests.support.processes import Program, free_port, run_here, wait_for, write_scenario


def read_yaml(text: str) -> Any:
    return YAML(typ="safe", pure=True).load(text)


@pytest.mark.parametrize(
    "text",
    [
        "{}",
        "{linear: {x: 0.5, y: -1}, angular: {z: 1e-3}}",
        "{data: [1, 2, 3], name: 'a b', flag: true, other: False, none: null, hexadecimal: 0x1F}",
        "{frame_id: map, path: /a/b, text: \"a: b, {c}\", empty: '', list: [{x: 1}, {x: 2}], deep: [[1], []]}",
        "{ a : 1 ,b: [ 1 , 2 ], c: }",
        "{x: .inf, y: -.inf}",
    ],
)
def test_flow_style_is_parsed_as_yaml_does(text: str) -> None:
    assert parse_values(text) == read_yaml(text)


def test_yaml_1_1_booleans_are_parsed_and_quoted_texts_are_not() -> None:
    """Texts are printed in quotes as ROS's own tools do, and are read as texts."""
    assert parse_values("{a: off, b: ON, c: No, d: yes, e: 'off', no: n}") == {
        "a": False, "b": True, "c": False, "d": True, "e": "off", "no": "n",
    }  # fmt: skip
    assert lines({"a": "off"}) == ['a: "off"']


# --- messages out


@pytest.mark.parametrize(
    "name", ["sensor_msgs/msg/Imu", "nav_msgs/msg/Odometry", "diagnostic_msgs/msg/DiagnosticArray"]
)
def test_printed_messages_are_yaml(name: str) -> None:
    message = ros_message.empty(name)
    if "status" in message:
        message["status"] = [
            ros_message.empty("diagnostic_msgs/msg/DiagnosticStatus") | {"message": "a: b", "name": "5"},
            ros_message.empty("diagnostic_msgs/msg/DiagnosticStatus") | {"values": [{"key": "k", "value": "true"}]},
        ]
    assert read_yaml("\n".join(lines(message))) == json.loads(json.dumps(message))


def test_the_listing_shows_topics_types_and_nodes() -> None:
    entities = [
        Entity("NN", "/uuv1", "s", 0, 0),
        Entity("MP", "/uuv1", "s", 0, 1, "/uuv1/imu", "sensor_msgs/msg/Imu", "h", Qos()),
        Entity("MS", "/b", "s", 0, 2, "/uuv1/imu", "sensor_msgs/msg/Imu", "h", Qos()),
        Entity("MS", "/a", "s", 0, 3, "/uuv1/imu", "sensor_msgs/msg/Imu", "h", Qos()),
        Entity("SS", "/uuv1", "s", 0, 4, "/uuv1/arm", "std_srvs/srv/SetBool", "h", Qos()),
    ]
    rows = [re.split("  +", line) for line in listing(entities).splitlines()]
    assert rows[2] == ["/uuv1/imu", "sensor_msgs/msg/Imu", "/uuv1", "/a, /b"]
    assert "/uuv1/arm  std_srvs/srv/SetBool  /uuv1        -" in listing(entities)
    assert listing(entities[:1]) == "no topics and no services"


def test_type_names_may_omit_msg() -> None:
    assert whole_type("geometry_msgs/Twist") == "geometry_msgs/msg/Twist"
    assert all(whole_type(name) == name for name in types.names() if "/msg/" in name)
    with pytest.raises(ConfigError, match="did you mean 'geometry_msgs/msg/Twist'"):
        whole_type("geometry_msgs/Twst")


# --- as a user runs it


class User:
    """Runs `uuv-hil topic` against a slave."""

    def __init__(self, folder: Path, slave: Program, port: int) -> None:
        self.folder, self.slave, self.endpoint = folder, slave, f"tcp/127.0.0.1:{port}"

    def start(self, *arguments: object) -> Program:
        return Program(self.folder, "topic", *arguments, "--connect", self.endpoint)

    def run(self, *arguments: object, code: int = 0) -> str:
        returned, output = run_here("topic", *map(str, arguments), "--connect", self.endpoint)
        assert (returned, "Traceback" in output) == (code, False), output
        return output


@pytest.fixture(scope="module")
def user(tmp_path_factory: pytest.TempPathFactory) -> Iterator[User]:
    folder = tmp_path_factory.mktemp("topic")
    scenario, port = write_scenario(folder)
    with Program(folder, "slave", scenario) as slave:
        slave.expect("ready")
        yield User(folder, slave, port)


def test_list_shows_topics_and_services_of_a_vehicle(user: User) -> None:
    text = user.run("list")
    assert re.search(r"/uuv1/imu +sensor_msgs/msg/Imu +/uuv1 +-\n", text)
    assert re.search(r"/uuv1/cmd_vel +geometry_msgs/msg/Twist +- +/uuv1\n", text)
    assert re.search(r"/tf_static +tf2_msgs/msg/TFMessage +/uuv1 +-\n", text)
    assert re.search(r"/uuv1/reset +std_srvs/srv/Trigger +/uuv1 +-\n", text)
    assert re.search(r"/uuv1/get_simulator_features +simulation_interfaces/srv/GetSimulatorFeatures +/uuv1 +-\n", text)
    entities = json.loads(user.run("list", "--json"))
    assert {"kind": "MP", "node": "/uuv1", "topic": "/uuv1/imu"}.items() <= next(
        entity.items() for entity in entities if entity["topic"] == "/uuv1/imu"
    )


def test_echo_prints_messages_and_late_latched_ones(user: User) -> None:
    message = read_yaml(user.run("echo", "/uuv1/odom", "-n", 1).removesuffix("---\n"))
    assert message["child_frame_id"] == "base_link"
    assert message["pose"]["pose"]["position"]["x"] == pytest.approx(4.0, abs=0.6)  # east
    late = read_yaml(user.run("echo", "/tf_static", "-n", 1).removesuffix("---\n"))
    assert {transform["child_frame_id"] for transform in late["transforms"]} > {"odom", "imu_link"}


def test_echo_continues_until_it_is_interrupted(user: User) -> None:
    with user.start("echo", "uuv1/pressure") as program:
        program.expect("(?s)fluid_pressure: .*fluid_pressure: ")
        assert program.stop(signal.SIGINT) == 0
        assert "Traceback" not in program.output


def test_hz_measures_the_rate(user: User) -> None:
    found = re.match(r"(\S+) Hz, gaps", user.run("hz", "/uuv1/imu", "-n", 60).splitlines()[-1])
    assert found
    assert float(found[1]) == pytest.approx(100.0, rel=0.4)


def test_pub_commands_the_vehicle(user: User) -> None:
    with user.start("pub", "/uuv1/cmd_vel", "geometry_msgs/Twist", "{linear: {x: 0.5}}") as program:
        program.expect("publishing geometry_msgs/msg/Twist on /uuv1/cmd_vel at 20 Hz")
        user.slave.expect("commands arrive: thrusters armed")
        assert program.stop(signal.SIGINT) == 0
    user.slave.expect("deadman")


def test_pub_publishes_any_type_under_its_own_node(tmp_path: Path) -> None:
    endpoint, received = f"tcp/127.0.0.1:{free_port()}", list[tuple[str, bytes]]()
    tokens: list[str] = []
    values = "{header: {frame_id: map}, ranges: [1.5, .inf, 2.0]}"
    with listen(endpoint) as other:
        other.subscribe_keys("0/**", lambda key, payload, _: received.append((key, payload)), 16)
        other.watch_tokens(graph.ALL, lambda key, alive: tokens.append(key) if alive else None)
        arguments = ("pub", "scan", "sensor_msgs/msg/LaserScan", values, "--rate", 20, "-n", 3, "--connect", endpoint)
        with Program(tmp_path, "topic", *arguments) as program:
            assert program.wait() == 0, program.output
        assert wait_for(lambda: len(received) == 3)

        def published() -> list[tuple[str, str]]:
            entities = [entity for key in tokens if (entity := graph.read_token(key))]
            return [(entity.node, entity.topic) for entity in entities if entity.kind == "MP"]

        found = wait_for(published)
    assert found == [(f"/uuv_hil_topic_{program.process.pid}", "/scan")]
    name = "sensor_msgs/msg/LaserScan"
    assert received[0][0] == f"0/scan/sensor_msgs::msg::dds_::LaserScan_/{types.type_hash(name)}"
    message = ros_message.decode(name, received[0][1])
    assert message is not None
    assert (message["ranges"], message["header"]["frame_id"]) == ((1.5, math.inf, 2.0), "map")


def test_ros_settings_of_the_scenario_select_topics_and_services(tmp_path: Path) -> None:
    section = '[ros]\nclock = "50 Hz"\nwrench = 10\ntransforms = false\nservices = false\nframe_prefix = "a/"'
    scenario, port = write_scenario(tmp_path, link=section)
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("ready")
        user = User(tmp_path, slave, port)
        assert re.match(r"\S+ Hz, gaps", user.run("hz", "/clock", "-n", 5).splitlines()[-1])
        output = [read_yaml(text)["clock"] for text in user.run("echo", "/clock", "-n", 20).split("---\n") if text]
        times = [clock["sec"] * 10**9 + clock["nanosec"] for clock in output]
        gaps = [after - before for before, after in pairwise(times)]
        assert min(gaps) == 20_000_000, "by its own time; where steps are skipped or messages dropped, more"
        wrench = read_yaml(user.run("echo", "/uuv1/thruster_wrench", "-n", 1).removesuffix("---\n"))
        assert wrench["header"]["frame_id"] == "a/base_link"
        assert wrench["wrench"]["force"] == {"x": 0.0, "y": 0.0, "z": 0.0}
        listed = user.run("list")
    assert "/uuv1/thruster_wrench" in listed
    assert "/tf" not in listed
    assert "/uuv1/arm" not in listed


def test_call_prints_the_reply_of_a_service(user: User) -> None:
    assert user.run("call", "/uuv1/arm", "{data: false}").startswith("success: true\n")
    user.slave.expect("arm: disarmed")
    assert "armed: commands are executed" in user.run("call", "/uuv1/arm", "std_srvs/srv/SetBool", "{data: on}")
    assert "disarmed" in user.run("call", "/uuv1/arm", "{data: OFF}")
    assert "armed: commands are executed" in user.run("call", "/uuv1/arm", "data = true")
    assert read_yaml(user.run("call", "/uuv1/reset"))["message"] == "at (4, 4, 2) m, heading 0 rad, at rest"


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("echo", "/uuv1/imo", "--wait", "2"), 4, "nobody publishes /uuv1/imo; there are: /clock, "),
        (("call", "/uuv1/rest"), 4, "no server for /uuv1/rest; there are: .*did you mean '/uuv1/reset'"),
        (("call", "/uuv1/arm", "std_srvs/Trigger"), 2, "/uuv1/arm has the type std_srvs/srv/SetBool, not"),
        (("call", "/uuv1/arm", "{date: 1}"), 2, "no field 'date'; did you mean 'data'"),
        (("pub", "/uuv1/cmd_vel", "std_msgs/msg/Bool"), 2, "has the type geometry_msgs/msg/Twist"),
        (("call", "/uuv1/arm", "{data: perhaps}"), 2, "SetBool_Request.data: expected true or false, found 'perhaps'"),
        (("call", "/uuv1/arm", '{data: "off"}'), 2, "SetBool_Request.data: expected true or false, found 'off'"),
        (("pub", "/x", "geometry_msgs/msg/Twist", "{linear: {x: a}}"), 2, "Twist.linear.x: expected a number"),
        (
            ("pub", "/x", "std_msgs/msg/Bool", "--rate", "-1"),
            2,
            "--rate: expected a number from 0.001 to 10000 Hz",
        ),
    ],
)
def test_errors_name_cause_and_remedy(user: User, arguments: tuple[str, ...], code: int, message: str) -> None:
    assert re.search(message, user.run(*arguments, code=code))
