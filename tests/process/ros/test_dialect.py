"""The ROS domain and release: read from the scenario or the environment, and used in keys, tokens and messages."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.network.publisher import key_of
from hil.network.roles import open_client_session, open_master_session
from hil.network.session import Session
from hil.recording.tap import Tap
from hil.ros import dialect, graph
from hil.ros import dvl as ros_dvl
from hil.ros import message as ros_message
from hil.ros import sensors as ros_sensors
from hil.ros.topics import TOPICS, TYPE_HASHES, hash_of
from hil.scenario.config import load_scenario
from sim.sensors.extra_samples import RangeSample
from sim.sensors.samples import DvlSample
from tests.support.processes import Program, wait_for, write_scenario

IMU = TOPICS["imu"]
CAMERA = '[sensors.camera]\nrate = "2 Hz"\nwidth = 64\nheight = 48\n[ros]\nimages = "raw"\n'


@pytest.fixture(autouse=True)
def default_dialect(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    dialect.select()
    yield
    monkeypatch.undo()
    dialect.select()


def nodes_and_topics(session: Session) -> tuple[list[str], set[str], list[tuple[str, int]]]:
    """Return what ROS shows: nodes, published topics, and the identifiers of entities."""
    entities = [entity for key in session.tokens(graph.ALL) if (entity := graph.read_token(key))]
    nodes = [entity.node for entity in entities if entity.kind == "NN"]
    return nodes, {e.topic for e in entities if e.kind == "MP"}, [(e.session, e.ident) for e in entities]


def scenario_with(folder: Path, text: str) -> str:
    path, _ = write_scenario(folder)
    path.write_text(path.read_text() + text)
    return str(path)


def test_the_domain_of_the_scenario_overrides_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load_scenario(scenario_with(tmp_path, ""))
    assert dialect.domain() == 0
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    load_scenario(scenario_with(tmp_path, ""))
    assert dialect.domain() == 42
    load_scenario(scenario_with(tmp_path, "[ros]\ndomain = 7\n"))
    assert dialect.domain() == 7
    monkeypatch.setenv("ROS_DOMAIN_ID", "")
    load_scenario(scenario_with(tmp_path, ""))
    assert dialect.domain() == 0


def test_keys_and_tokens_have_the_domain_and_the_release() -> None:
    entity = graph.Entity("MP", "/uuv1", "ab", 0, 1, "/uuv1/imu", IMU.type, TYPE_HASHES[IMU.type])
    at_home = graph.token(entity)
    assert at_home.startswith("@ros2_lv/0/")
    dialect.select(5, "humble")
    assert key_of(IMU, "uuv1") == "5/uuv1/imu/sensor_msgs::msg::dds_::Imu_/TypeHashNotSupported"
    assert graph.token(entity).startswith("@ros2_lv/5/")
    assert graph.read_token(graph.token(entity)) == entity
    assert graph.read_token(at_home) is None, "of another domain"
    dialect.select(5, "mink")
    assert (dialect.release(), dialect.is_newer("mink"), dialect.is_newer("jazzi")) == ("rolling", True, False)
    assert key_of(IMU, "uuv1") == f"5/uuv1/imu/sensor_msgs::msg::dds_::Imu_/{TYPE_HASHES[IMU.type]}"


def test_services_that_changed_with_lyrical_have_another_hash() -> None:
    name = "simulation_interfaces/srv/SetEntityState"
    before = hash_of(name)
    assert before == "RIHS01_ca210e7d2b66629ae133c8e1edf5246e618106d75c78ed0556c0e7a33c59ee5e"
    dialect.select(0, "lyrical")
    assert hash_of(name) == "RIHS01_fba636c91d38832dbd4f6896ffce54ff98fd9929962b0533546b56ce00f988ac"
    assert "set_pose" in ros_message.empty(f"{name}_Request")
    dialect.select(0, "kilted")
    assert hash_of(name) == before
    assert "set_pose" not in ros_message.empty(f"{name}_Request")


def test_range_messages_of_humble_have_no_variance() -> None:
    sample, depth = DvlSample(1, (0.0, 0.0, 0.0), 12.5, True), RangeSample(1, 3.5, (0.5, 10.0))
    new_messages = ros_dvl.encode_range(sample, variance=0.25), ros_sensors.encode_distance(depth, variance=0.25)
    dialect.select(0, "humble")
    old_messages = ros_dvl.encode_range(sample, variance=0.25), ros_sensors.encode_distance(depth, variance=0.25)
    assert [data[:-4] for data in new_messages] == list(old_messages)
    assert [ros_dvl.decode_range(data) for data in (new_messages[0], old_messages[0])] == [(1, 12.5)] * 2
    assert [ros_sensors.decode_distance(data) for data in (new_messages[1], old_messages[1])] == [depth] * 2


def test_a_slave_of_another_domain_is_received_there_and_nowhere_else(tmp_path: Path) -> None:
    path, port = write_scenario(tmp_path)
    path.write_text(path.read_text() + '[ros]\ndistro = "humble"\n')
    received: dict[str, int] = {}

    def receive(key: str, _payload: bytes, _attachment: bytes) -> None:
        received["/".join(key.split("/")[:3])] = key.count("TypeHashNotSupported")

    with Program(tmp_path, "slave", path, environment={"ROS_DOMAIN_ID": "9"}) as slave:
        slave.expect("ready")
        with open_master_session(f"tcp/127.0.0.1:{port}") as session:
            for domain in (0, 9):
                session.subscribe_keys(f"{domain}/**", receive, 64)
            assert wait_for(lambda: "9/uuv1/imu" in received)
            assert received["9/uuv1/imu"] == 1, "and Humble has no hashes"
            assert not [key for key in received if key.startswith("0/")]
        dialect.select(9, "humble")
        with Tap([f"tcp/127.0.0.1:{port}"]) as tap:
            assert wait_for(lambda: [message for message in tap.receive() if message.topic == "/uuv1/imu"])
        with Program(tmp_path, "topic", "hz", "/uuv1/imu", "--connect", f"tcp/127.0.0.1:{port}", "--count", 5,
                     environment={"ROS_DOMAIN_ID": "9"}) as topic:  # fmt: skip
            assert topic.wait(60) == 0, topic.output


def test_a_vehicle_with_a_camera_is_one_node(tmp_path: Path) -> None:
    path, port = write_scenario(tmp_path)
    path.write_text(path.read_text() + CAMERA + 'distro = "mink"\n')
    with Program(tmp_path, "slave", path) as slave:
        slave.expect("'mink' is not known here, and acts as rolling")
        with open_client_session(f"tcp/127.0.0.1:{port}", seconds=30.0) as session:
            assert wait_for(lambda: {"/uuv1/imu", "/uuv1/camera/camera_info"} <= nodes_and_topics(session)[1], 60)
            nodes, _, ids = nodes_and_topics(session)
    assert nodes == ["/uuv1"]
    assert len(ids) == len(set(ids)), "no two endpoints are one to ROS"
