"""Recordings: complete after every flush, readable by other tools, limited in size, safe to read."""

import os
import sys
import threading
import time
import tracemalloc
from collections import Counter
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader
from rosbags.rosbag2 import Reader

from hil.common.errors import ConfigError
from hil.recording.mcap_file import Message, qos_profile, schema_of
from hil.recording.mcap_writer import RecordingFile
from hil.recording.reader import About, read_about, read_messages
from hil.recording.recorder import Recorder, describe
from hil.recording.run import read_run
from hil.ros import encoders as ros
from hil.ros.topics import TOPICS
from hil.scenario.config import load_scenario
from sim.sensors.samples import OdometrySample
from tests.support.network.small_recording import SMALL, by_mcap, by_rosbags, imu


class SlowCounter(int):
    """A counter whose addition always lets another thread run in between."""

    def __add__(self, other: int) -> "SlowCounter":
        time.sleep(0.002)
        return SlowCounter(int(self) + other)


@pytest.mark.parametrize("fails", [False, True])
def test_messages_of_several_threads_are_all_counted(fails: bool, tmp_path: Path) -> None:
    with Recorder(str(tmp_path / "bag"), SMALL, {}) as recorder:
        recorder.lost, recorder._put = SlowCounter(0), SlowCounter(0)
        if fails:
            recorder.failure = "the disk is full"
        threads = [threading.Thread(target=recorder.put, args=(imu(number),)) for number in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    size = len(imu(0).data)
    assert (recorder.written, recorder.lost, recorder._put) == ((0, 8, 0) if fails else (8, 0, 8 * size))


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_a_file_is_complete_after_every_flush(tmp_path: Path, compression: str) -> None:
    path = tmp_path / "one.mcap"
    file = RecordingFile(str(path), {"seed": "7"}, {"scenario.toml": "seed = 7\n"}, compression)
    sent_messages: list[Message] = []
    for number in range(1, 2001):
        sent_messages.append(imu(number, f"/uuv{number % 3 + 1}/imu"))
        file.write(sent_messages[-1])
        if number in (1, 50, 700, 1999):
            file.flush()
            assert by_mcap(path) == sent_messages
            assert [z for _, _, z in by_rosbags(path)] == pytest.approx([-(9.8 + n) for n in range(1, number + 1)])
            assert list(read_messages(str(path))) == sent_messages
    summary = file.close()
    assert by_mcap(path) == list(read_messages(str(path))) == sent_messages
    assert len(by_rosbags(path)) == 2000
    assert summary.size == path.stat().st_size
    assert summary.first_ns == sent_messages[0].logged_ns
    assert summary.last_ns == sent_messages[-1].logged_ns
    assert read_about(str(path)) == ({"seed": "7"}, {"scenario.toml": "seed = 7\n"})


def test_the_index_leads_to_the_messages(tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"
    file = RecordingFile(str(path), {"a": "b"}, {"x": "y"}, "zstd")
    sent_messages = [imu(number, f"/uuv{number % 2}/imu") for number in range(1, 3000)]
    for message in sent_messages:
        file.write(message)
    file.close()
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary
        assert summary.statistics
        assert summary.statistics.message_count == 2999
        assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 10
        assert (summary.statistics.message_start_time, summary.statistics.message_end_time) == (
            sent_messages[0].logged_ns,
            sent_messages[-1].logged_ns,
        )
        assert {channel.metadata["offered_qos_profiles"] for channel in summary.channels.values()} == {
            qos_profile("/uuv1/imu")
        }
        assert [schema.encoding for schema in summary.schemas.values()] == ["ros2msg"]
        first, last = sent_messages[1000].logged_ns, sent_messages[1500].logged_ns
        found = reader.iter_messages(topics=["/uuv1/imu"], starting_at=first, ending_before=last)
        assert [m.sequence for _, _, m in found] == [
            m.sequence for m in sent_messages if m.topic == "/uuv1/imu" and first <= m.logged_ns < last
        ]
        assert [each.name for each in reader.iter_attachments()] == ["x"]
        assert [each.metadata for each in reader.iter_metadata()] == [{"a": "b"}]
        stream.seek(0)
        assert (
            sum(isinstance(record, McapMessage) for record in StreamReader(stream, validate_crcs=True).records) == 2999
        )


def test_a_long_recording_takes_no_memory_for_its_index(tmp_path: Path) -> None:
    """500 flushes with 30 topics: in memory their index takes 1 MB."""
    path = tmp_path / "long.mcap"
    written = RecordingFile(str(path), {}, {}, "none")
    messages = [Message(f"/uuv1/topic{number}", "std_msgs/msg/Float64", 1, 1, 1, bytes(12)) for number in range(30)]
    tracemalloc.start()
    try:
        for time_ns in range(1, 501):
            for message in messages:
                written.write(message._replace(logged_ns=time_ns))
            written._end_chunk()
            written._stream.commit(b"")
            if time_ns == 100:
                before, _ = tracemalloc.get_traced_memory()
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    written.close()
    assert grown < 50_000
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary
        assert summary.statistics
        assert (len(summary.chunk_indexes), summary.statistics.chunk_count) == (500, 500)
        assert {len(index.message_index_offsets) for index in summary.chunk_indexes} == {30}
    assert sum(message.topic == "/uuv1/topic7" for message in read_messages(str(path))) == 500


def test_every_message_type_has_its_schema() -> None:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    for kind in sorted({topic.type for topic in TOPICS.values()}):
        encoding, text = schema_of(kind)
        assert encoding == "ros2msg"
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(text.decode(), kind))
        from hil.ros.topics import hash_of

        assert store.hash_rihs01(kind) == hash_of(kind), kind
    assert schema_of("my_msgs/msg/Thing") == ("", b"")


def test_rotation_keeps_within_its_bounds_and_the_index_follows(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    with Recorder(str(folder), SMALL, {"seed": "1"}) as recorder:
        for number in range(1, 40_001):
            recorder.put(imu(number, noise=True))
    assert (recorder.written, recorder.lost, recorder.failure) == (40_000, 0, "")
    sizes = {name: (folder / name).stat().st_size for name in os.listdir(folder) if name.endswith(".mcap")}
    assert len(sizes) >= 2
    assert "bag_0.mcap" not in sizes, "the oldest went"
    assert max(sizes.values()) <= 1 << 20
    assert sum(sizes.values()) <= 2 << 20
    numbers = [message.sequence for message in read_messages(str(folder))]
    assert numbers == list(range(numbers[0], 40_001)), "what stays is without a gap"
    with Reader(folder) as reader:
        assert reader.message_count == len(numbers) == sum(1 for _ in reader.messages())
        assert reader.start_time == imu(numbers[0]).logged_ns
        (connection,) = reader.connections
        assert (connection.topic, connection.msgtype, connection.msgcount) == (
            "/uuv1/imu",
            "sensor_msgs/msg/Imu",
            len(numbers),
        )
    assert len(by_rosbags(folder)) == len(numbers)


def test_topics_are_recorded_with_their_qos(tmp_path: Path) -> None:
    from rosbags.interfaces import QosDurability, QosReliability

    with Recorder(str(tmp_path / "bag"), SMALL, {}) as recorder:
        recorder.put(imu(1))
        recorder.put(Message("/tf_static", "tf2_msgs/msg/TFMessage", 1, 5, 5, b"\0\1\0\0\0\0\0\0"))
    with Reader(tmp_path / "bag") as reader:
        offered = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}  # type: ignore[union-attr]
    assert offered["/uuv1/imu"].durability == QosDurability.VOLATILE
    assert offered["/uuv1/imu"].reliability == QosReliability.RELIABLE
    assert offered["/tf_static"].durability == QosDurability.TRANSIENT_LOCAL


def test_an_empty_recording_is_valid(tmp_path: Path) -> None:
    Recorder(str(tmp_path / "bag"), SMALL, {}).close()
    assert list(read_messages(str(tmp_path / "bag"))) == []
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == 0


def test_the_scenario_is_read_from_a_recording(tmp_path: Path) -> None:
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "uuv-hil"
    scenario = load_scenario("paper_field")._replace(seed=42)
    about, files = describe(scenario, "slave", board="raspberry_pi_4b")
    with Recorder(str(tmp_path / "bag"), SMALL, about, files) as recorder:
        recorder.put(imu(1))
    before = set(os.listdir(cache)) if cache.exists() else set()
    info = read_about(str(tmp_path / "bag"))
    assert info.facts["board"] == "raspberry_pi_4b"
    assert {"uuv_hil_version", "python_version", "scenario", "node", "seed", "vehicle", "world"} <= set(info.facts)
    run = read_run(info, "bag")
    assert run
    assert run.scenario.seed == 42
    assert run.scenario.start == scenario.start
    assert (run.vehicle.name, run.world.name) == ("paper_six", "paper_field")
    assert not {name for name in os.listdir(cache) if "uuv-hil-" in name} - before, "no litter"
    damaged = info._replace(attachments=info.attachments | {"vehicle.toml": "mass = 3"})
    with pytest.raises(ConfigError, match="bag: what it says of its run"):
        read_run(damaged, "bag")


@pytest.mark.parametrize(
    "section",
    [
        '[[force]]\nclass = "{}:Pull"',
        '[sensors.mine]\nclass = "{}:Warmth"\nrate = 1',
    ],
)
def test_classes_of_a_recording_are_loaded_only_on_request(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, section: str
) -> None:
    monkeypatch.chdir(tmp_path)
    name = f"strange_{section[2:6]}"
    (tmp_path / f"{name}.py").write_text(
        f"open({str(tmp_path / 'trace')!r}, 'w').close()\n"
        "class Pull:\n"
        "    def begin(self, time_ns): pass\n"
        "    def wrench(self, position, rotation, nu_r): return [0.0] * 6\n"
        "class Warmth:\n"
        "    message = 'std_msgs/msg/Float64'\n"
        "    def begin(self, scene, mounting, random): pass\n"
        "    def sample(self, time_ns, state): return {}\n"
    )
    about, files = describe(load_scenario("paper_field"), "slave")
    files["scenario.toml"] += "\n" + section.format(name)
    with Recorder(str(tmp_path / "bag"), SMALL, about, files) as recorder:
        recorder.put(imu(1))
    info = read_about(str(tmp_path / "bag"))
    with pytest.raises(ConfigError, match=rf"'{name}:\w+' is not loaded: .*--own-classes, only if you trust"):
        read_run(info, "bag")
    assert not (tmp_path / "trace").exists()
    monkeypatch.setattr(sys, "path", [*sys.path])
    run = read_run(info, "bag", own_classes=True)
    assert run
    assert run.scenario.force or "mine" in run.scenario.sensors
    assert (tmp_path / "trace").exists()


def test_only_the_three_scenario_files_of_a_recording_are_used(tmp_path: Path) -> None:
    about, files = describe(load_scenario("paper_field"), "slave")
    assert read_run(About(about, files | {"..": "", "other.toml": "x = 1"}), "bag")


def test_recordings_of_other_writers_are_read(tmp_path: Path) -> None:
    """The bag is by another writer: it has no metadata of this project, and unknown types."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    sample = OdometrySample(5_000_000_000, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), (0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        odom = writer.add_connection("/uuv1/odom", "nav_msgs/msg/Odometry", typestore=store)
        text = writer.add_connection("/chat", "std_msgs/msg/String", typestore=store)
        writer.write(odom, 5, ros.encode_odometry(sample))
        writer.write(text, 6, b"\0\1\0\0\2\0\0\0a\0")
    found = list(read_messages(str(tmp_path / "bag")))
    assert Counter(message.topic for message in found) == {"/uuv1/odom": 1, "/chat": 1}
    assert found[0].data == ros.encode_odometry(sample)
    assert read_about(str(tmp_path / "bag")) == ({}, {})


def test_sequence_numbers_wrap_at_32_bits(tmp_path: Path) -> None:
    file = RecordingFile(str(tmp_path / "one.mcap"), {}, {}, "none")
    file.write(imu(1)._replace(sequence=(1 << 32) + 3))
    file.close()
    assert next(read_messages(str(tmp_path / "one.mcap"))).sequence == 3


def test_a_file_without_an_index_is_in_the_order_of_its_log_times(tmp_path: Path) -> None:
    """Rosbags reads it in that order: a killed recorder leaves such a file, with messages of several sources."""
    start = time.time_ns()
    with Recorder(str(tmp_path / "bag"), SMALL, {}) as recorder:
        for number in range(0, 60, 2):
            early, late = (imu(n)._replace(logged_ns=start + 20_000_000 * n) for n in (number, number + 1))
            recorder.put(late)
            time.sleep(max(0.0, (late.logged_ns - time.time_ns()) / 1e9))
            recorder.put(early)
        left = tmp_path / "left.mcap"
        left.write_bytes((tmp_path / "bag" / "bag_0.mcap").read_bytes())
    with left.open("rb") as file:
        times = [record.log_time for record in StreamReader(file).records if isinstance(record, McapMessage)]
    assert len(times) > 20
    assert times == sorted(times)
