"""record, replay, plot and foxglove as a user runs them, with a real slave."""

import signal
import threading
import time
from collections import Counter, defaultdict
from contextlib import suppress
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader

from hil.common.errors import HilError
from hil.network.opening import listen
from hil.plots.run_data import collect
from hil.recording.mcap_file import Message
from hil.recording.player import Player
from hil.recording.reader import read_about, read_messages
from hil.recording.recorder import Recorder
from hil.ros import encoders as ros
from hil.ros.topics import TOPICS
from hil.scenario.records import Recording
from tests.support.network.recorded_dive import record_dive
from tests.support.processes import Program, free_port, run_here, wait_for

SENSORS = {"imu", "dvl", "dvl_twist", "altitude", "pressure", "odom", "ground_truth"}


@pytest.fixture(scope="module")
def dive(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, str]:
    return record_dive(tmp_path_factory.mktemp("dive"))


def test_both_recordings_hold_the_same_messages_of_all_topics(dive: tuple[Path, Path, str]) -> None:
    """The recordings agree but for what the network dropped in a busy moment, which `record` counts."""
    _, received, reported = dive
    read_by_hil, read_by_mcap = (
        {(message.topic, message.sequence): message.data for message in read_messages(str(path))} for path in dive[:2]
    )
    topics = Counter(topic for topic, _ in read_by_hil)
    assert {f"/uuv1/{name}" for name in SENSORS} <= set(topics)
    assert topics["/uuv1/cmd_vel"] > 25
    assert topics["/uuv1/pulses"] > 40
    shared = set(read_by_hil) & set(read_by_mcap)
    assert all(read_by_hil[key] == read_by_mcap[key] for key in shared)
    numbers = defaultdict(list)
    for topic, number in read_by_mcap:
        numbers[topic].append(number)
    assert all(each == sorted(each) for each in numbers.values())
    missing = sum(each[-1] - each[0] + 1 - len(each) for each in numbers.values())
    assert (f"{missing} not received" if missing else "none lost") in reported
    assert len(numbers["/uuv1/imu"]) > missing
    with AnyReader([received]) as reader:
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
        assert reader.message_count == len(read_by_mcap)


def test_a_recording_describes_its_run(dive: tuple[Path, Path, str]) -> None:
    facts = read_about(str(dive[0])).facts
    assert facts["seed"] == "5"
    assert facts["recorded_by"] == "slave"
    assert facts["board"]
    assert facts["uuv_hil_version"]
    assert "scenario.toml" in read_about(str(dive[1])).attachments


def test_a_replay_check_repeats_the_run_bit_for_bit(tmp_path: Path, dive: tuple[Path, Path, str]) -> None:
    code, output = run_here("recording", "replay", str(dive[0]), "--check")
    assert (code, "the same bit for bit" in output) == (0, True), output
    code, output = run_here("recording", "replay", str(dive[1]), "--check")
    assert (code, "slave's own recording" in output) == (2, True), output


def rewritten(path: Path, folder: Path, new_facts: dict[str, str], kept_pulses: range, flip: int = 0) -> Path:
    """Return a recording like that at `path`, with other facts, or a pulse changed, or some of its messages only."""
    about, pulses = read_about(str(path)), 0
    with Recorder(str(folder), Recording(keep_free=0.0), about.facts | new_facts, about.attachments) as recorder:
        for number, message in enumerate(read_messages(str(path))):
            if message.topic.endswith("/pulses"):
                pulses += 1
                if pulses == flip:
                    step, first, *others = ros.decode_int64_array(message.data) or ()
                    message = message._replace(data=ros.encode_int64_array([step, first + 1, *others]))
            if number in kept_pulses:
                recorder.put(message)
    return folder


@pytest.mark.parametrize(
    ("new_facts", "kept_pulses", "flip", "code", "messages"),
    [
        ({"seed": "6"}, range(10**6), 0, 6, ["then the simulator differs", "recorded ", "repeated "]),
        ({}, range(10**6), 20, 6, ["then the simulator differs", "/uuv1/"]),
        ({}, range(100, 10**6), 0, 2, ["its beginning is missing", "record it again"]),
        ({}, range(10**6), 0, 0, ["the same bit for bit"]),
        ({}, range(2), 0, 2, ["no samples to compare"]),
    ],
)
def test_the_replay_check_reports_what_differs(
    tmp_path: Path,
    dive: tuple[Path, Path, str],
    new_facts: dict[str, str],
    kept_pulses: range,
    flip: int,
    code: int,
    messages: list[str],
) -> None:
    path = rewritten(dive[0], tmp_path / "changed", new_facts, kept_pulses, flip)
    found, output = run_here("recording", "replay", str(path), "--check")
    assert found == code, output
    assert all(word in output for word in messages), output


def test_a_replay_to_the_network_sends_what_the_vehicle_sent(tmp_path: Path, dive: tuple[Path, Path, str]) -> None:
    endpoint, copy = f"tcp/127.0.0.1:{free_port()}", tmp_path / "again"
    with Program(tmp_path, "recording", "make", "--connect", endpoint, "-o", copy) as record:
        record.expect("recording")
        start = time.monotonic()
        with Program(
            tmp_path, "recording", "replay", dive[1], "--listen", endpoint, "--speed", "4", "--wait", "60"
        ) as replay:
            assert replay.wait() == 0, replay.output
        duration = time.monotonic() - start
        assert record.stop(signal.SIGINT) == 0
    assert "none lost" in record.output
    then, now = (sorted((m.topic, m.type, m.data) for m in read_messages(str(path))) for path in (dive[1], copy))
    assert now == then
    played = [message.logged_ns for message in read_messages(str(dive[1]))]
    assert duration > 0.9 * (max(played) - min(played)) / 4e9


def test_a_slow_receiver_gets_the_whole_replay(tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with Program(tmp_path, "recording", "make", "--connect", endpoint, "-o", tmp_path / "received") as record:
        with listen(endpoint) as session:
            assert wait_for(session.watch_keys("0/uuv1/trace/**"))
            player = Player(session)
            record.process.send_signal(signal.SIGSTOP)
            wakes = threading.Timer(0.4, record.process.send_signal, [signal.SIGCONT])  # before it counts as lost
            wakes.start()
            for number in range(1000):  # much more than the sockets hold
                player.send(Message("/uuv1/trace", TOPICS["trace"].type, number, 0, 0, bytes(20_000)))
            wakes.join()

            def all_received() -> bool:
                with suppress(HilError, OSError):  # of a recording that is under way
                    return sum(1 for _ in read_messages(str(tmp_path / "received"))) == 1000
                return False

            assert wait_for(all_received)
        assert record.stop(signal.SIGINT) == 0
    assert "1000 messages recorded, none lost" in record.output


def test_the_data_of_the_figures_match_the_flight(dive: tuple[Path, Path, str]) -> None:
    (own,), (received,) = (collect(read_messages(str(path)), str(path)).values() for path in dive[:2])
    for data in (own, received):
        assert [row[1:] for row in data.commands[1:-1]] == [(0.5, 0.0, 0.1, 0.3)] * (len(data.commands) - 2)
        assert len(data.delays) == len(data.traced) > 10, "but for what did not come"
        assert 0 < min(data.delays.totals_ns()) < 1e9
        north, east, depth, _, surge = data.true[-10][1:6]
        assert surge == pytest.approx(0.5, abs=0.15)
        assert (north - 4) ** 2 + (east - 4) ** 2 > 0.2
        assert depth > 2.05
        assert {len(row) for row in data.pulses} == {7}
        assert (data.channels[0], len(data.channels)) == ("front_right", 6)
    assert len(own.pulses) > 5 * len(received.pulses), "the slave's own have every change"
    assert received.true[0][1:] in [row[1:] for row in own.true], "a recorder may come after the first"
