"""Every panel of the Foxglove layout has data: of a running vehicle, and of its recording."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet  # type: ignore[import-untyped]
from google.protobuf.descriptor_pool import DescriptorPool  # type: ignore[import-untyped]
from google.protobuf.message_factory import GetMessageClass  # type: ignore[import-untyped]
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from hil.gateways.foxglove.layout import layout
from hil.scenario.config import load_scenario
from tests.support.processes import Program, free_port, run_here, write_scenario

SENSORS = """
[sensors.camera]
rate = 5
width = 64
height = 48
[sensors.forward_sonar]
rate = 2
beams = 64
[sensors.laser]
[sensors.profiler]
"""
MASTER_TOPICS = {"/uuv1/cmd_vel", "/uuv1/plan"}  # nobody commands here
STORE = get_typestore(Stores.ROS2_JAZZY)


@pytest.fixture(scope="module")
def opened_layout(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Path]]:
    """Provide a slave with pictures and scans: its scenario, and a folder."""
    folder = tmp_path_factory.mktemp("shown")
    scenario, _ = write_scenario(folder, top=SENSORS)
    with Program(folder, "slave", scenario) as slave:
        slave.expect("ready")
        yield scenario, folder


def topics_of(node: str, scenario: str) -> set[str]:
    """Return all topics that the panels of the layout show."""
    panels = json.loads(layout(node, load_scenario(scenario)))["configById"]
    topics = set()
    for name, panel in panels.items():
        kind = name.partition("!")[0]
        if kind == "3D":
            topics |= set(panel["topics"])
        elif kind == "Image":
            topics.add(panel["imageMode"]["imageTopic"])
        elif kind == "Plot":
            topics |= {path["value"].partition(".")[0] for path in panel["paths"]}
        elif kind.startswith("Diagnostic"):
            topics.add(panel["topicToRender"])
    return topics - MASTER_TOPICS


def test_each_panel_has_data_of_a_running_vehicle(opened_layout: tuple[Path, Path]) -> None:
    scenario, folder = opened_layout
    missing = topics_of("uuv1", str(scenario))
    assert {"/scene", "/uuv1/forward_sonar/fan/image_raw", "/uuv1/camera/image_raw/compressed"} < missing
    with Program(folder, "gateway", "foxglove", "--scenario", scenario, "--listen", free_port()) as gateway:
        address = gateway.expect(r"(ws://\S+) shows").group(1)
        topics: dict[int, str] = {}
        with connect(address, subprotocols=[Subprotocol("foxglove.sdk.v1")], max_size=None) as socket:
            while missing:
                message = socket.recv(60)
                if isinstance(message, bytes):
                    if message[0] == 1:  # not a time
                        missing.discard(topics[int.from_bytes(message[1:5], "little")])
                    continue
                for channel in json.loads(message).get("channels", []):
                    topics[channel["id"]] = channel["topic"]
                    wanted = [{"id": channel["id"], "channelId": channel["id"]}]
                    socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


def test_each_panel_has_data_of_a_recording(opened_layout: tuple[Path, Path]) -> None:
    scenario, folder = opened_layout
    bag, target = folder / "bag", folder / "foxglove.mcap"
    assert run_here("recording", "make", "--scenario", str(scenario), "-o", str(bag), "--seconds", "8")[0] == 0
    code, output = run_here("recording", "replay", str(bag), "--foxglove", str(target))
    assert code == 0, output
    messages = read(target)
    assert topics_of("uuv1", str(scenario)) - messages.keys() == set()
    (scene,) = messages["/scene"]
    assert [entity.id for entity in scene.entities] == ["world", "vehicle"]
    fan = messages["/uuv1/forward_sonar/fan/image_raw"][0]
    assert (fan.encoding, fan.width * fan.height) == ("mono8", len(fan.data))
    code, output = run_here("recording", "replay", str(bag), "--foxglove", str(target))
    assert code == 2
    assert "choose another file" in output


def read(path: Path) -> dict[str, list[Any]]:
    """Return all messages by topic, decoded by the schemas in the file."""
    messages: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema
            if schema.encoding == "protobuf":
                value = protobuf_class(schema.name, schema.data).FromString(message.data)
            elif schema.name in STORE.types:
                value = STORE.deserialize_cdr(message.data, schema.name)
            else:
                value = message.data
            messages.setdefault(channel.topic, []).append(value)
    return messages


def protobuf_class(name: str, definition: bytes) -> Any:
    pool, files = DescriptorPool(), FileDescriptorSet()
    files.ParseFromString(definition)
    for file in files.file:
        pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName(name))
