"""The recipes of CONTRIBUTING.md, followed step by step."""

import re
import shutil
from pathlib import Path
from typing import NamedTuple

import pytest

from boards import load_board
from hil.common.schema import preset_folder
from hil.links.contract import Protocol, ThrusterCommand, Wire
from hil.links.frame.protocol import open_frame
from hil.links.protocols import PROTOCOLS, Role, open_protocol
from hil.links.wires.terminal import PtyHostWire, PtyWire
from hil.ros import encoders, topics, types
from hil.ros.message import decode, encode
from hil.ros.types import definition
from sim.dynamics import State
from sim.environment.world import load_world
from sim.sensors.extra_samples import FlagSample
from sim.sensors.kinds import SENSORS, Kind
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene
from sim.sensors.sensor_set import read_sensors
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle
from tests.support.links.link_contract import LinkContract
from tools import ros_types

HERE = "tests.unit.test_recipes"
TEXT = (Path(__file__).parents[2] / "CONTRIBUTING.md").read_text(encoding="utf-8")


class DoorModel(NamedTuple):
    """The settings of the door: rate in Hz."""

    rate: float = 10.0


class Door:
    """A switch that is closed below 1 m."""

    Model = DoorModel
    topic = "door"

    def __init__(self, model: DoorModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._mounting = mounting

    def sample(self, time_ns: int, state: State) -> FlagSample:
        return FlagSample(time_ns, self._mounting.depth(state) > 1.0)


def test_the_sensor_recipe_works(monkeypatch: pytest.MonkeyPatch) -> None:
    kind = Kind(f"{HERE}:Door", "door", "std_msgs/msg/Bool", 10.0, "true if it is closed")
    monkeypatch.setitem(SENSORS, "door", kind)
    monkeypatch.setitem(topics.TOPICS, "door", *topics.topics_of(kind))
    monkeypatch.setattr(encoders, "_ENCODERS", dict(encoders._ENCODERS))
    fitted = read_sensors({"door": {"rate": 20.0, "position": [0.1, 0.0, 0.0]}}, "mine.toml")
    vehicle, _ = load_vehicle("paper_six")
    simulation = Simulation(vehicle, load_world("pool"), position=(4.0, 4.0, 2.0), sensors=fitted)
    steps = [simulation.step((1500,) * len(vehicle.channels)) for _ in range(400)]
    samples = [sample for step in steps for name, sample in step if name == "door"]
    assert len(samples) == 20
    assert isinstance(samples[-1], FlagSample)
    assert samples[-1].on
    ((topic, payload),) = encoders.encoder("door")(samples[-1], "")
    assert topic == "door"
    decode = encoders.decoder("door")
    assert decode is not None
    assert decode(payload) is True


def pty_pair() -> tuple[Wire, Wire]:
    device = PtyWire()
    return device, PtyHostWire(device.path)


def open_mine(role: Role, channels: int) -> Protocol:
    """Return a custom protocol, here another name of the frame."""
    return open_frame(role, channels)


def test_the_thruster_protocol_recipe_works(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PROTOCOLS, "mine", f"{HERE}:open_mine")
    host, device = open_protocol("mine", "host", 6), open_protocol("mine", "device", 6)
    command = ThrusterCommand(7, True, (1500, 1600, 1400, 1500, 1550, 1450))
    assert device.feed(host.encode(command)) == [command]


def test_the_board_recipe_works(tmp_path: Path) -> None:
    copy = tmp_path / "mine.toml"
    text = Path(preset_folder("boards"), "generic_arm64.toml").read_text(encoding="utf-8")
    copy.write_text(text, encoding="utf-8")
    assert load_board(str(copy)).serial == load_board("generic_arm64").serial


def test_the_vehicle_recipe_works(tmp_path: Path) -> None:
    copy = tmp_path / "mine.toml"
    text = Path(preset_folder("sim/vehicles"), "bluerov2.toml").read_text(encoding="utf-8")
    copy.write_text(re.sub(r"(?m)^mass = .*$", "mass = 10.5", text), encoding="utf-8")
    assert load_vehicle(str(copy))[0].mass != load_vehicle("bluerov2")[0].mass


class TestThrusterProtocolRecipe(LinkContract):
    """The conformance tests of the custom protocol, on a pseudo terminal."""

    open_wires = staticmethod(pty_pair)
    protocol = "mine"

    @pytest.fixture(autouse=True)
    def _named(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(PROTOCOLS, "mine", f"{HERE}:open_mine")


def test_the_message_recipe_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = Path(shutil.copytree(types.__path__[0], tmp_path / "types"))
    (folder / "mine_msgs.msg").write_text(
        "=== mine_msgs/msg/Door\nstd_msgs/Header header\nbool closed\n", encoding="utf-8"
    )
    monkeypatch.setattr(types, "_FOLDER", str(folder))
    topic = topics.TOPICS["leak"]._replace(name="door", type="mine_msgs/msg/Door")
    monkeypatch.setitem(topics.TOPICS, "door", topic)
    assert [field.name for field in definition(topic.type).fields] == ["header", "closed"]
    decoded = decode(topic.type, encode(topic.type, {"closed": True}))
    assert decoded is not None
    assert decoded["closed"] is True
    assert ros_types.type_hash(topic.type).startswith("RIHS01_")


def test_each_topic_has_a_definition() -> None:
    for topic in topics.TOPICS.values():
        assert definition(topic.type)


def test_the_files_named_by_the_recipes_exist() -> None:
    root = Path(__file__).parents[2]
    named = re.findall(r"`((?:hil|sim|boards|tests|docs|tools)/[\w/.]+)`", TEXT)
    assert len(named) > 10
    assert [name for name in named if "NAME" not in name and not (root / name).exists()] == []
