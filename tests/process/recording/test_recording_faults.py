"""A recording under faults: a truncated file, a kill, a full disk, too many messages."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader

import hil.recording.recorder as recording_module
from hil.common.clock import NS_PER_S, now_ns, to_wall_ns
from hil.common.errors import ConfigError
from hil.recording.mcap_file import Message
from hil.recording.mcap_writer import RecordingFile
from hil.recording.reader import read_messages
from hil.recording.recorder import Recorder, new_folder
from hil.ros.encoders import decode_int64_array
from tests.support.busy import retried_when_busy
from tests.support.network.small_recording import SMALL, by_mcap, by_rosbags, imu
from tests.support.processes import ROOT, wait_for


def test_a_truncated_file_is_read_up_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"
    file = RecordingFile(str(path), {"seed": "7"}, {}, "zstd")
    messages = [imu(number, noise=True) for number in range(1, 800)]
    for message in messages:
        file.write(message)
    file.close()
    content, torn = path.read_bytes(), tmp_path / "torn.mcap"
    rng, max_lost = random.Random(5), 0
    for _ in range(60):
        cut = rng.randrange(1500, len(content))
        garbage = bytes(rng.randrange(256) for _ in range(rng.choice((0, 4096))))
        torn.write_bytes(content[:cut] + garbage)
        found = list(read_messages(str(torn)))
        assert found == messages[: len(found)]
        max_lost = max(max_lost, len(found))
    assert max_lost > 600
    for broken in (b"", b"\x89MCAP0\r\n", b"not a recording", content[:20]):
        torn.write_bytes(broken)
        with pytest.raises(ConfigError, match=r"torn\.mcap"):
            list(read_messages(str(torn)))


RECORD = """
import sys, time
from hil.recording import recorder as recorder_module
from hil.scenario.records import Recording
from hil.recording.recorder import Recorder
from tests.support.network.small_recording import imu
recorder_module.INDEX_PERIOD_NS = 0
recorder = Recorder(sys.argv[1], Recording(keep_free=0.0), {"seed": "7"})
began, number = time.monotonic(), 0
while True:
    while number < 2000 * (time.monotonic() - began):
        number += 1
        recorder.put(imu(number, noise=True))
        print(number, time.monotonic_ns(), flush=True)
    time.sleep(0.001)
"""


@retried_when_busy("a process is killed, and others are late")
def test_a_kill_loses_at_most_the_last_second(tmp_path: Path) -> None:
    own = tmp_path / str(time.monotonic_ns())
    own.mkdir()
    folder, printed = own / "bag", own / "printed"
    with printed.open("w") as stdout:
        process = subprocess.Popen(
            [sys.executable, "-c", RECORD, str(folder)],
            stdout=stdout,
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
    wait_for(lambda: printed.stat().st_size > 100_000)
    time.sleep(0.4)
    process.send_signal(signal.SIGKILL)
    process.wait()
    killed_ns = time.monotonic_ns()
    rows = [tuple(map(int, line.split())) for line in printed.read_text().splitlines()[:-1]]
    path = folder / "bag_0.mcap"
    sequences = [message.sequence for message in read_messages(str(path))]
    assert sequences == list(range(1, len(sequences) + 1))
    lost_since = next(at for number, at in rows if number > len(sequences))
    assert 0.0 < (killed_ns - lost_since) / 1e9 < 1.3, "a second, and what it takes to notice"
    assert [m.sequence for m in by_mcap(path)] == sequences, "the library's reader"
    with path.open("rb") as stream:
        assert [r.sequence for r in StreamReader(stream).records if isinstance(r, McapMessage)] == sequences
    assert len(by_rosbags(path)) == len(sequences), "others' reader, of the file"
    assert len(by_rosbags(folder)) == len(sequences), "and of the folder, whose index was there from the beginning"
    indexed = json.loads((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]["message_count"]
    assert len(sequences) / 2 < indexed <= len(sequences), "as of some seconds before, here of the flush before"


FILL = """
import resource, sys, time
from hil.scenario.records import Recording
from hil.recording.recorder import Recorder
from tests.support.network.small_recording import imu
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
reports = []
recorder = Recorder(sys.argv[1], Recording(keep_free=0.0), {"seed": "7"}, report=reports.append)
number = 0
while not reports and number < 30_000:
    number += 1
    recorder.put(imu(number, noise=True))
    time.sleep(0.0002)
recorder.put(imu(0))
recorder.close()
print(reports == [recorder.failure], recorder.lost, recorder.failure)
"""


def test_a_full_disk_ends_only_the_recording(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    completed = subprocess.run(
        [sys.executable, "-c", FILL, str(folder)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=100,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    reported, lost, failure = completed.stdout.strip().split(" ", 2)
    assert reported == "True", completed.stderr
    assert int(lost) >= 1
    assert str(folder) in failure
    assert "File too large" in failure
    sequences = [message.sequence for message in by_mcap(folder / "bag_0.mcap")]
    assert sequences == list(range(1, len(sequences) + 1))
    assert len(sequences) > 10, "what was written before the last chunk"
    assert len(by_rosbags(folder)) == len(sequences)


def test_free_space_is_left_on_the_disk(tmp_path: Path) -> None:
    reported: list[str] = []
    recorder = Recorder(str(tmp_path / "bag"), SMALL._replace(keep_free=1e7), {}, report=reported.append)
    assert wait_for(lambda: reported)
    recorder.put(imu(1))
    recorder.close()
    assert recorder.lost == 1
    assert "keep_free" in reported[0]
    assert "free some space" in reported[0]


def test_messages_beyond_the_queue_are_counted_as_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording_module, "MAX_WAITING", 100)
    monkeypatch.setattr(recording_module, "DRAIN_PERIOD_S", 5.0)
    with Recorder(str(tmp_path / "bag"), SMALL, {}) as recorder:
        for number in range(1, 151):
            recorder.put(imu(number))
    assert (recorder.written, recorder.lost) == (100, 50)


def test_a_delayed_recorder_writes_messages_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Seconds may pass on a busy machine between reading the clock and fetching the messages."""
    passed_ns: list[int] = []
    monkeypatch.setattr(recording_module, "now_ns", lambda: now_ns() + sum(passed_ns))

    def delayed_source() -> list[Message]:
        if passed_ns:
            return []
        began = to_wall_ns(now_ns())
        passed_ns.append(3 * NS_PER_S)
        return [imu(number)._replace(logged_ns=began + (2 * number - 1) * NS_PER_S // 2) for number in (1, 2, 3)]

    with Recorder(str(tmp_path / "bag"), SMALL, {}, source=delayed_source):
        assert wait_for(lambda: passed_ns)
    assert [message.sequence for message in read_messages(str(tmp_path / "bag"))] == [1, 2, 3]


@pytest.mark.parametrize("set_by_s", [-3600, 3600, 95_865_992])
def test_log_times_do_not_jump_when_the_clock_is_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, set_by_s: int
) -> None:
    """A board without a clock chip starts in the past. The recording keeps how its times relate to the new clock."""
    began_ns, shift_ns = to_wall_ns(now_ns()), 0
    monkeypatch.setattr(recording_module, "to_wall_ns", lambda time_ns: to_wall_ns(time_ns) + shift_ns)
    folder, about = tmp_path / "bag", {"node": "uuv1"}
    with Recorder(str(folder), SMALL, about) as recorder:
        for number in range(1, 31):
            if number == 16:
                recorder.put(imu(number)._replace(logged_ns=to_wall_ns(now_ns())))  # still by the clock before
                shift_ns = set_by_s * NS_PER_S
            else:
                recorder.put(imu(number)._replace(logged_ns=to_wall_ns(now_ns()) + shift_ns))
            time.sleep(0.01)
        ended_ns = to_wall_ns(now_ns())
    found = by_mcap(folder / "bag_0.mcap")
    times = [message.logged_ns for message in found]
    assert times == sorted(times)
    assert began_ns <= times[0] < times[-1] <= ended_ns + NS_PER_S // 2
    assert sorted(message.sequence for message in found if message.topic == "/uuv1/imu") == list(range(1, 31))
    (shift,) = [message for message in found if message.topic == "/uuv1/clock_shift"]
    assert list(decode_int64_array(shift.data) or ()) == pytest.approx([set_by_s * NS_PER_S], abs=NS_PER_S)


def test_a_clock_before_1970_does_not_end_a_recording(tmp_path: Path) -> None:
    messages = [imu(1), imu(2)._replace(published_ns=-1), imu(3)]
    with Recorder(str(tmp_path / "bag"), SMALL, {}) as recorder:
        for message in messages:
            recorder.put(message)
    assert (recorder.written, recorder.failure) == (3, "")
    found = by_mcap(tmp_path / "bag" / "bag_0.mcap")
    assert found == [messages[0], messages[1]._replace(published_ns=0), messages[2]]


def test_an_error_that_ends_the_recording_is_reported(tmp_path: Path) -> None:
    reported: list[str] = []
    with Recorder(str(tmp_path / "bag"), SMALL, {}, report=reported.append) as recorder:
        recorder.put(imu(1))
        assert wait_for((tmp_path / "bag" / "bag_0.mcap").exists)
        recorder.put(imu(2)._replace(logged_ns=-1))  # which no clock says
        assert wait_for(lambda: reported)
        recorder.put(imu(3))
    assert reported == [recorder.failure]
    assert recorder.failure.startswith(f"recording into {tmp_path / 'bag'} ended: error: ")
    assert recorder.lost == 1
    assert by_mcap(tmp_path / "bag" / "bag_0.mcap") in ([], [imu(1)]), "whole up to the last flush"


def test_a_source_is_polled_until_the_end(tmp_path: Path) -> None:
    messages = [imu(number, noise=True) for number in range(1, 2001)]
    portions = [messages[:700], [], messages[700:1990]]
    with Recorder(str(tmp_path / "bag"), SMALL, {}, source=lambda: portions.pop(0) if portions else []) as recorder:
        recorder.put(imu(1, "/uuv2/imu"))
        assert wait_for(lambda: recorder.written == 1991)
        portions.append(messages[1990:])
    found = list(read_messages(str(tmp_path / "bag")))
    assert [message for message in found if message.topic == "/uuv1/imu"] == messages
    assert [message for message in found if message.topic == "/uuv2/imu"] == [imu(1, "/uuv2/imu")]


def test_an_existing_recording_is_not_overwritten(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    Recorder(str(folder), SMALL, {}).close()
    with pytest.raises(ConfigError, match="choose another"):
        Recorder(str(folder), SMALL, {})
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="cannot be made"):
        Recorder(str(tmp_path / "file"), SMALL, {})
    Recorder(new_folder("uuv1", str(tmp_path)), SMALL, {}).close()


def test_the_recorder_thread_has_no_real_time_priority() -> None:
    """A slave's thread under SCHED_FIFO makes it; writing must not run before the vehicle's loop."""
    code = """
import os, sys, threading, time, json
os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
from hil.scenario.records import Recording
from hil.recording.recorder import Recorder
with Recorder(sys.argv[1], Recording(keep_free=0.0), {}) as recorder:
    time.sleep(0.3)
    policies = {t.name: os.sched_getscheduler(t.native_id) for t in threading.enumerate()}
print(json.dumps(policies))
"""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        completed = subprocess.run(
            [sys.executable, "-c", code, f"{folder}/bag"], capture_output=True, text=True, cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )  # fmt: skip
    assert json.loads(completed.stdout) == {"MainThread": os.SCHED_BATCH, "recorder": os.SCHED_OTHER}, completed.stderr
