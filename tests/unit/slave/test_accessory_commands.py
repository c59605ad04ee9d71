"""Commands of accessories in the slave: who may give them, and how they reach the imaging process."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.ros.joints import encode_accessories
from hil.scenario.config import load_scenario
from hil.slave.imaging.process import Studio
from tests.support.flights.flying import Bench, twist

MASTER, OTHER = b"m" * 16, b"o" * 16
LIT = """
vehicle = "bluerov2"
world = "pool"
master = {}
start = { north = 5, east = 4, depth = 2 }
[sensors.camera]
width = 32
height = 24
lamps = 5.0
exposure = 0.5
water = "clear"
field_of_view = 0.2
"""


class Sender(Bench):
    """A bench that keeps the accessories that are moved."""

    def __init__(self) -> None:
        super().__init__()
        self.moved: dict[str, float] = {}
        self.command_receiver.move = self.moved.update

    def light(self, share: float, gid: bytes) -> None:
        self.send("cmd_accessories", encode_accessories(0, {"lights": share}), gid)


@pytest.fixture
def sender() -> Iterator[Sender]:
    made = Sender()
    yield made
    made.command_receiver.close()


def test_accessories_need_the_permission_of_the_active_master_and_make_none(sender: Sender) -> None:
    receiver = sender.command_receiver
    sender.light(0.5, OTHER)  # nobody commands
    assert (sender.moved, receiver.master, receiver.take_latest()) == ({"lights": 0.5}, b"", None)
    receiver.ranks[MASTER] = 0
    sender.send("cmd_vel", twist(surge=0.2), MASTER)
    sender.light(0.1, OTHER)
    assert (sender.moved, receiver.refused) == ({"lights": 0.5}, 1)
    sender.light(0.2, MASTER)
    assert sender.moved == {"lights": 0.2}
    newest = receiver.take_latest()
    assert newest, "the velocity still counts"
    assert newest.sequence == 2


def test_a_vehicle_without_accessories_says_so(sender: Sender) -> None:
    sender.command_receiver.move = None
    sender.light(1.0, MASTER)
    assert sender.command_receiver.malformed == 1
    assert sender.command_receiver.fault == "cmd_accessories: the vehicle has no [accessories]"


def test_the_imaging_process_uses_lights_and_tilt_of_a_request(tmp_path: Path) -> None:
    path = tmp_path / "lit.toml"
    path.write_text(LIT)
    scenario = load_scenario(str(path))
    studio = Studio(scenario._replace(sensors={"camera": scenario.sensors["camera"]}))

    def look(lights: float, tilt: float) -> tuple[float, float]:
        taken: Any = studio.take_sample(0, 0, [5.0, 4.0, 2.0, 1.0, 0.0, 0.0, 0.0, *[0.0] * 12, lights, tilt])
        depth = np.frombuffer(taken[1].depth, np.float32)
        return float(np.frombuffer(taken[1].rgb, np.uint8).mean()), float(np.median(depth))

    bright, ahead = look(1.0, 0.0)
    dark, _ = look(0.0, 0.0)
    _, down = look(1.0, -1.2)
    assert bright > dark + 5.0
    assert down < 0.7 * ahead
