"""Manual changes to a recorded vehicle are in the recording and are repeated by `replay --check`."""

import signal
import time
from pathlib import Path
from typing import Any

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import VehicleClient
from hil.common.errors import ConfigError
from hil.network.roles import open_master_session
from hil.network.services import call
from hil.recording import check as recording_check
from hil.recording.events import EVENTS, decode_event, encode_failures, encode_place, repeat
from hil.recording.reader import read_about, read_messages
from hil.recording.recorder import Recorder
from hil.ros import message as ros_message
from hil.ros.topics import TOPICS
from hil.scenario.records import Recording
from sim.environment.world import load_world
from sim.sensors.kinds import SENSORS
from sim.simulation import Simulation
from sim.vehicle.failures import Failure
from sim.vehicle.vehicle import load_vehicle
from tests.support.processes import Program, run_here, write_scenario

RECORDING = '[recording]\nslave = true\nfolder = "{folder}"\nkeep_free = 0\n'
# A third and a square root, which no short decimal number is.
POSE = {
    "position": {"x": 10 / 3, "y": 5.5, "z": -1.7},
    "orientation": {"w": 0.9, "x": 0.05, "y": -0.02, "z": 2**0.5 / 4},
}


@pytest.fixture(scope="module")
def dive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record a dive with every service that changes the vehicle, each while it moves."""
    folder = tmp_path_factory.mktemp("dive")
    scenario, port = write_scenario(folder, top="seed = 5")
    with scenario.open("a") as file:
        file.write(RECORDING.format(folder=folder / "recordings"))
    endpoint = f"tcp/127.0.0.1:{port}"
    with Program(folder, "slave", scenario) as slave:
        slave.expect("recording into")
        with open_master_session(endpoint) as session, VehicleClient(session, "uuv1") as client:
            assert client.wait_for_vehicle(60)

            def fly() -> None:
                for _ in range(15):
                    client.command(VelocityCommand(surge=0.5, heave=0.1, yaw_rate=0.4))
                    time.sleep(0.02)

            fail = f"/uuv1/thrusters/{thruster_names()[0]}/fail"
            fly()
            assert call(session, fail, "std_srvs/srv/SetBool", {"data": True})["success"]
            fly()
            state = {"pose": POSE, "twist": {"linear": {"x": 0.1 / 3}, "angular": {"z": 0.2}}}
            placed = call(session, "/uuv1/set_pose", "simulation_interfaces/srv/SetEntityState", {"state": state})
            assert placed["result"]["result"] == 1, placed
            fly()
            assert call(session, fail, "std_srvs/srv/SetBool", {"data": False})["success"]
            fly()
            assert call(session, "/uuv1/reset", "std_srvs/srv/Trigger")["success"]
            fly()
        assert slave.stop(signal.SIGTERM) == 0, slave.output
    (made,) = (folder / "recordings").iterdir()
    return made


def thruster_names() -> list[str]:
    return [thruster.name for thruster in load_vehicle("paper_six")[0].thrusters]


def test_a_run_with_services_repeats_bit_for_bit(tmp_path: Path, dive: Path) -> None:
    code, output = run_here("recording", "replay", str(dive), "--check")
    assert (code, "the same bit for bit" in output) == (0, True), output


def test_each_event_is_in_the_recording(dive: Path) -> None:
    events = [decode_event(m.data) for m in read_messages(str(dive)) if m.topic == "/uuv1/events"]
    kinds = [next(key for key in event if key != "step") for event in events]
    assert kinds == ["fail", "place", "fail", "fail", "place"], "a reset repairs all, then places"
    assert [len(event["fail"]) for event in events if "fail" in event] == [1, 1, len(thruster_names())]
    assert events[1]["place"][0] == [5.5, 10 / 3, 1.7]
    assert events[4]["place"][0] == [4.0, 4.0, 2.0]
    steps = [event["step"] for event in events]
    assert steps == sorted(steps)
    assert steps[0] > 0


def remove_chunk(path: Path, folder: Path, number: int) -> Path:
    """Return the recording without one of its events, the others numbered on."""
    about, count = read_about(str(path)), 0
    with Recorder(str(folder), Recording(keep_free=0.0), about.facts, about.attachments) as recorder:
        chunks = 0
        for message in read_messages(str(path)):
            if message.topic == "/uuv1/events":
                chunks += 1
                if chunks == number:
                    continue
                count += 1
                message = message._replace(sequence=count)
            recorder.put(message)
    return folder


@pytest.mark.parametrize("number", [1, 2, 3, 5])
def test_leaving_out_an_event_changes_the_repetition(tmp_path: Path, dive: Path, number: int) -> None:
    """The repetition differs if an event is not applied again."""
    verdict = recording_check.check(str(remove_chunk(dive, tmp_path / "less", number)))
    assert "/uuv1/" in verdict.difference
    assert verdict.compared > 20


def test_a_missing_event_is_detected(tmp_path: Path, dive: Path) -> None:
    about = read_about(str(dive))
    with Recorder(str(tmp_path / "less"), Recording(keep_free=0.0), about.facts, about.attachments) as recorder:
        for message in read_messages(str(dive)):
            if (message.topic, message.sequence) != ("/uuv1/events", 4):  # which another follows at once
                recorder.put(message)
    with pytest.raises(ConfigError, match="1 messages of /uuv1/events are missing"):
        recording_check.check(str(tmp_path / "less"))


def test_events_are_encoded_exactly() -> None:
    position, quaternion, nu = (1 / 3, -0.1, 2e-17), (0.5, 0.5, -0.5, 0.5), (0.1, 0.2, 0.3, -1 / 7, 0.0, 1e300)
    event = decode_event(encode_place(7, position, quaternion, nu))
    assert event == {"step": 7, "place": [list(position), list(quaternion), list(nu)]}
    failures = [Failure("bow", "noisy", 1.5, noise=1 / 3), Failure("stern", "stuck", pwm_us=1600)]
    event = decode_event(encode_failures(8, failures))
    assert [Failure(**each) for each in event["fail"]] == failures


@pytest.mark.parametrize(
    "text",
    ["", "{", "[1]", '{"place": []}', '{"step": 1.5, "fail": []}'],
)
def test_a_malformed_event_is_ignored(text: str) -> None:
    assert decode_event(ros_message.encode(EVENTS.type, {"data": text})) == {}
    assert decode_event(b"\xff" * 9) == {}


@pytest.mark.parametrize(
    "event",
    [{"place": [1, 2, 3]}, {"place": [[1.0]]}, {"fail": [{"kind": "off"}]}, {"fail": [{"thruster": "no_such"}]}],
)
def test_a_wrong_event_is_a_config_error(event: dict[str, Any]) -> None:
    simulation = Simulation(load_vehicle("paper_six")[0], load_world("pool"), position=(4.0, 4.0, 2.0))
    with pytest.raises(ConfigError):
        repeat(event, simulation)


def test_every_topic_is_compared_or_left_out_on_purpose() -> None:
    """A new topic is a sample, which the repetition publishes too, or is listed as none."""
    output = {"/tf", *[stream.topic for kind in SENSORS.values() for stream in kind.streams]}
    pictures = {name for name in TOPICS if "/" in name[1:]}  # another process says them, in its own time
    ours = {name for name, topic in TOPICS.items() if not topic.from_master}
    assert ours - pictures - output == recording_check.NOT_SAMPLES - recording_check.COMMANDS
