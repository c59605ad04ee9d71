"""Services, pictures and the map by lines of JSON: reset, poses, failures, arming, camera and sonar pictures."""

import array
import json
from base64 import b64decode
from math import hypot, isfinite

import pytest

import hil
from hil.client.fleet import Fleet
from tests.support.clients.json_client import Client, Message, client, gateway, own_state, seeing_fleet
from tests.support.processes import wait_for

__all__ = ["client", "gateway", "own_state", "seeing_fleet"]  # the fixtures

pytest.importorskip("numpy", reason="pictures and maps need numpy")


def position_of(client: Client) -> list[float]:
    position: list[float] = client.call(do="get", sensor="ground_truth")["sample"]["position"]
    return position


def distance(client: Client, north: float, east: float, depth: float) -> float:
    here = position_of(client)
    return hypot(here[0] - north, here[1] - east, here[2] - depth)


def test_a_pose_is_set_and_reset(client: Client, fleet: Fleet) -> None:
    """The previous command ends, or the vehicle would return."""
    assert client.call(do="go_to", north=7, east=7, depth=2)["ok"]
    answer = client.call(do="set_pose", north=7, east=3, depth=1.5, heading=1.0)
    assert answer == {"id": None, "ok": True, "message": "put at (7, 3, 1.5) m"}
    assert wait_for(lambda: distance(client, 7, 3, 1.5) < 0.3)
    assert client.call(do="get", sensor="ground_truth")["sample"]["heading"] == pytest.approx(1.0, abs=0.3)
    assert client.call(do="status") == {"id": None, "ok": True, "done": False, "over": True, "error": ""}
    assert "(4, 4, 2) m" in client.call(do="reset")["message"]
    assert wait_for(lambda: distance(client, 4, 4, 2) < 0.3)


def efforts(fleet: Fleet) -> dict[str, float]:
    """Return the force of each thruster (N)."""
    joints = fleet["uuv1"].newest("joint_states")
    return dict(zip(joints.names, map(abs, joints.efforts), strict=True))


def test_a_thruster_fails_and_is_repaired(client: Client, fleet: Fleet) -> None:
    names = list(efforts(fleet))
    assert client.call(do="thrust", newtons=[5.0] * len(names))["ok"]
    assert wait_for(lambda: min(efforts(fleet).values()) > 3)
    assert client.call(do="fail", thruster=names[0])["message"] == f"{names[0]} is off"
    assert wait_for(lambda: efforts(fleet)[names[0]] < 0.1)
    assert efforts(fleet)[names[1]] > 3
    assert client.call(do="fail", thruster=names[0], kind="efficiency", value=0.5)["ok"]
    assert wait_for(lambda: 1.5 < efforts(fleet)[names[0]] < 3.5), "the one before it is over"
    assert client.call(do="fail", thruster=names[0], kind="repaired")["ok"]
    assert wait_for(lambda: efforts(fleet)[names[0]] > 3.5)


def test_a_disarmed_vehicle_refuses_commands_and_an_armed_one_accepts_them(client: Client, fleet: Fleet) -> None:
    assert client.call(do="arm", on=False)["ok"]
    assert wait_for(lambda: fleet["uuv1"].diagnostics.armed is False)
    assert "is disarmed" in client.call(do="drive", surge=0.1)["error"]
    assert client.call(do="arm")["ok"]
    assert wait_for(lambda: fleet["uuv1"].diagnostics.armed)
    assert client.call(do="drive", surge=0.1)["ok"]


def test_only_disarming_is_allowed_while_another_master_commands(client: Client, fleet: Fleet) -> None:
    with hil.connect(*fleet.endpoints, take_over=True, wait=60.0) as other:
        other["uuv1"].drive(surge=0.1)
        assert wait_for(fleet["uuv1"].client.refusal)
        for line in ({"do": "reset"}, {"do": "set_pose", "north": 4, "east": 4, "depth": 2}, {"do": "arm"}):
            assert "is commanded by another master" in client.send(json.dumps(line).encode())["error"]
        assert client.call(do="arm", on=False)["ok"]
        assert wait_for(lambda: fleet["uuv1"].diagnostics.armed is False)
    assert wait_for(lambda: client.call(do="arm")["ok"])


def sample(client: Client, sensor: str) -> Message:
    answer = client.call(do="get", sensor=sensor)
    assert answer["ok"], answer
    taken: Message = answer["sample"]
    return taken


def test_pictures_scans_and_the_map_are_read(client: Client) -> None:
    picture = sample(client, "camera/image_raw")
    assert (picture["width"], picture["height"], picture["encoding"]) == (64, 48, "rgb8")
    pixels = b64decode(picture["data"])
    assert len(pixels) == 64 * 48 * 3
    assert len(set(pixels)) > 10, "it sees something"
    sonar = sample(client, "forward_sonar/image")
    size = {"uint8": 1, "float32": 4}[sonar["encoding"]]
    assert len(b64decode(sonar["intensities"])) == size * sonar["bins"] * len(sonar["beams"])
    laser = sample(client, "laser")
    assert len(laser["ranges"]) == 91
    assert any(distance is not None and isfinite(distance) for distance in laser["ranges"])
    map_sample = sample(client, "map")
    cells = array.array("B", b64decode(map_sample["cells"]))
    assert set(cells) <= {0, 1}
    assert len(cells) % map_sample["columns"] == 0
    assert (map_sample["south"], map_sample["west"], map_sample["resolution"]) == (-10.0, -10.0, 0.25)


def test_subscribed_pictures_are_sent(client: Client) -> None:
    assert client.call(do="subscribe", sensor="camera/image_raw", rate=5)["ok"]
    messages = [client.read() for _ in range(3)]
    assert {message["sensor"] for message in messages} == {"camera/image_raw"}
    times = [message["sample"]["time_ns"] for message in messages]
    assert times == sorted(set(times))
