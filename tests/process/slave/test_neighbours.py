"""Two slaves of a fleet: the camera and the sonar of one show the other at its position."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.client.client import VehicleClient
from hil.common.clock import NS_PER_S
from hil.network.roles import open_master_session, open_router_session
from hil.network.services import call
from hil.network.session import Session
from hil.network.settings import Network
from hil.ros import encoders as ros
from hil.scenario.config import Scenario, load_scenario
from hil.scenario.fleet import as_member
from hil.slave.imaging.neighbours import Neighbours
from sim.rotations import from_euler
from sim.sensors.samples import OdometrySample
from sim.vehicle.vehicle import load_vehicle
from tests.support.processes import Program, free_port, wait_for

WIDTH, HEIGHT = 48, 36
SCENARIO = """
vehicle = "paper_six"
world = "open_water"
{network}
[start]
depth = 5
[master]
goal = [8, 7]
[sensors.camera]
rate = 10
width = {width}
height = {height}
ground_truth = true
[sensors.forward_sonar]
rate = 5
beams = 32
max_range = 10
ground_truth = true
[[member]]
node = "one"
listen = "tcp/127.0.0.1:{one}"
agent = "tcp/127.0.0.1:{one}0"
north = 0
east = 0
[[member]]
node = "two"
listen = "tcp/127.0.0.1:{two}"
agent = "tcp/127.0.0.1:{two}0"
north = 2
east = 0
"""
TOPICS = ("camera/depth/image_raw", "camera/labels", "forward_sonar/image", "camera/camera_info")
LENGTH, BREADTH, TALL = load_vehicle("paper_six")[0].dimensions


def write(folder: Path, network: str = "") -> tuple[Path, int, int]:
    one, two = free_port(), free_port()
    path = folder / "two.toml"
    text = SCENARIO.format(network=network, width=WIDTH, height=HEIGHT, one=one, two=two)
    path.write_text(text.replace(f":{one}0", ":7411").replace(f":{two}0", ":7413"))
    return path, one, two


class Viewer:
    """A viewer of vehicle one, which can move vehicle two."""

    def __init__(self, client: VehicleClient, mover: Session, two: Program) -> None:
        self.client, self._mover, self.two = client, mover, two
        client.watch(*TOPICS)

    def middle(self) -> float:
        """Return the depth (m) in the middle of its picture; inf before the first."""
        latest = self.client.latest.get("camera/depth/image_raw")
        if latest is None:
            return float("inf")
        return float(np.frombuffer(latest.value.data, "<f4").reshape(HEIGHT, WIDTH)[HEIGHT // 2, WIDTH // 2])

    def send_position(self, north: float, east: float, depth: float) -> None:
        """Put vehicle two somewhere, its bow to the north."""
        pose = {"position": {"x": east, "y": north, "z": -depth}, "orientation": {"z": 0.5**0.5, "w": 0.5**0.5}}
        request = {"state": {"pose": pose}}
        answer = call(self._mover, "/two/set_pose", "simulation_interfaces/srv/SetEntityState", request)
        assert answer["result"]["result"] == 1, answer


@pytest.fixture(scope="module", params=["direct", "routed"])
def viewer(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Viewer]:
    folder = tmp_path_factory.mktemp(request.param)
    with ExitStack() as stack:
        network, text = Network(), ""
        if request.param == "routed":
            router = f"tcp/127.0.0.1:{free_port()}"
            network, text = Network(mode="routed", router=router), f'[network]\nmode = "routed"\nrouter = "{router}"'
            stack.enter_context(open_router_session(router, network))
        path, one, two = write(folder, text)
        endpoints = [network.router] * 2 if network.router else [f"tcp/127.0.0.1:{port}" for port in (one, two)]
        slaves = [stack.enter_context(Program(folder, "slave", path, "--member", name)) for name in ("one", "two")]
        for slave in slaves:
            slave.expect("ready")
        mover = stack.enter_context(open_master_session(endpoints[1], network=network))
        seeing = stack.enter_context(open_master_session(endpoints[0], network=network))
        yield Viewer(stack.enter_context(VehicleClient(seeing, "one", network=network)), mover, slaves[1])


def test_the_camera_shows_the_other_vehicle_at_its_position(viewer: Viewer) -> None:
    """The stern is half a length nearer than the centre, and has the width and height of the vehicle."""
    assert wait_for(lambda: abs(viewer.middle() - (2.0 - LENGTH / 2.0)) < 0.1), viewer.middle()
    assert wait_for(lambda: {"camera/labels", "camera/camera_info"} <= set(viewer.client.latest))
    focal = viewer.client.latest["camera/camera_info"].value.intrinsics.fx
    expected = [focal * size / (2.0 - LENGTH / 2.0) for size in (BREADTH, TALL)]

    def sizes() -> list[int]:
        """Return breadth and height (pixels) in the picture of labels, which may come later than that of depths."""
        labels = np.frombuffer(viewer.client.latest["camera/labels"].value.data, "<i4").reshape(HEIGHT, WIDTH)
        on_it = labels == labels[HEIGHT // 2, WIDTH // 2]
        return [int(on_it.any(axis).sum()) for axis in (0, 1)]

    assert wait_for(lambda: sizes() == pytest.approx(expected, abs=1.0)), (sizes(), expected)


def test_the_sonar_detects_the_other_vehicle(viewer: Viewer) -> None:
    """The strongest echo of the middle beam comes from its stern."""

    def loudest() -> float:
        latest = viewer.client.latest.get("forward_sonar/image")
        if latest is None:
            return 0.0
        sonar = latest.value
        image = np.frombuffer(sonar.intensities, "<f4").reshape(sonar.bins, len(sonar.beams))
        return float(sonar.first_range + (image[:, len(sonar.beams) // 2].argmax() + 0.5) * sonar.range_step)

    assert wait_for(lambda: abs(loudest() - (2.0 - LENGTH / 2.0)) < 0.3), loudest()


def test_the_other_vehicle_moves_and_disappears_with_its_slave(viewer: Viewer) -> None:
    viewer.send_position(2.5, 0.0, 5.0)
    assert wait_for(lambda: abs(viewer.middle() - (2.5 - LENGTH / 2.0)) < 0.1), viewer.middle()
    viewer.send_position(-3.0, 0.0, 5.0)
    assert wait_for(lambda: viewer.middle() > 6.0), viewer.middle()
    viewer.send_position(3.0, 0.0, 5.0)
    assert wait_for(lambda: abs(viewer.middle() - (3.0 - LENGTH / 2.0)) < 0.1), viewer.middle()
    assert viewer.two.stop(2) == 0
    assert wait_for(lambda: viewer.middle() > 6.0), "a silent vehicle is not shown"


# --- by itself


@pytest.fixture
def scenario(tmp_path: Path) -> Scenario:
    return as_member(load_scenario(str(write(tmp_path)[0])), "one")


class Received(Neighbours):
    """Neighbours that receive their states from the test instead of the network."""

    def receive_from(self, node: str, sample: OdometrySample, came_ns: int) -> None:
        self._store_samples(node)("ground_truth", ros.encode_odometry(sample, "map", "base_link"), b"")
        if node in self._received:
            self._received[node] = came_ns, self._received[node][1]


SAMPLE = OdometrySample(5, (1.0, 2.0, 3.0), from_euler(0.0, 0.0, np.pi / 2), (0.4, 0.0, 0.1, 0.0, 0.0, 0.5))


def test_a_neighbour_is_extrapolated_between_samples_and_removed_after_a_timeout(scenario: Scenario) -> None:
    received = Received(scenario, load_vehicle(scenario.vehicle)[0])
    assert list(received.states) == ["two"], "not itself"
    state = received.states["two"]
    received.place_hulls(NS_PER_S)
    assert state.position[2] > 1e5, "no state received yet"
    received.receive_from("two", SAMPLE, NS_PER_S)
    received.place_hulls(NS_PER_S + NS_PER_S // 2)
    assert state.position == pytest.approx([1.0, 2.2, 3.05])  # its bow is in the east
    assert state.quaternion == pytest.approx(from_euler(0.0, 0.0, np.pi / 2 + 0.25), abs=1e-3)
    received.place_hulls(2 * NS_PER_S + 1)
    assert state.position[2] > 1e5


@pytest.mark.parametrize(
    "changes",
    [
        {"position": (np.nan, 0.0, 0.0)}, {"position": (1e7, 0.0, 0.0)}, {"orientation": (0.0, 0.0, 0.0, 0.0)},
        {"orientation": (np.nan, 0.0, 0.0, 0.0)}, {"nu": (np.inf, 0.0, 0.0, 0.0, 0.0, 0.0)},
    ],
)  # fmt: skip
def test_impossible_states_of_a_neighbour_are_ignored(scenario: Scenario, changes: dict[str, Any]) -> None:
    received = Received(scenario, load_vehicle(scenario.vehicle)[0])
    received.receive_from("two", SAMPLE._replace(**changes), NS_PER_S)
    received.place_hulls(NS_PER_S)
    assert received.states["two"].position[2] > 1e5
    received._store_samples("two")("ground_truth", b"\xff" * 9, b"")


def test_a_sensor_without_ray_casting_is_not_changed(scenario: Scenario) -> None:
    Neighbours(scenario, load_vehicle(scenario.vehicle)[0]).stand_before(object())
    assert Neighbours(scenario._replace(member=()), load_vehicle(scenario.vehicle)[0]).states == {}
