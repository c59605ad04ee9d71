"""Hostile recordings that would take much memory or time: refused in one line, or read within bounds."""

import struct
import subprocess
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import lz4.frame
import pytest
import zstandard

from hil.common.errors import ConfigError
from hil.plots import run_data
from hil.plots.run_data import Rows, collect
from hil.recording import records as recording_records
from hil.recording.mcap_file import Message
from hil.recording.reader import read_about, read_messages
from hil.ros import encoders as ros

MAGIC = recording_records.MAGIC
MIB = 1 << 20


def record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def text(content: str) -> bytes:
    return struct.pack("<I", len(content)) + content.encode()


def chunk(content: bytes, size: int, packing: str = "zstd") -> bytes:
    """Return a chunk with `content` whose header gives `size` bytes."""
    return record(6, struct.pack("<QQQI", 0, 0, size, 0) + text(packing) + struct.pack("<Q", len(content)) + content)


def zeros(size: int) -> bytes:
    packer = zstandard.ZstdCompressor(level=19).compressobj()
    piece = bytes(MIB)
    return b"".join([packer.compress(piece) for _ in range(size // MIB)]) + packer.flush()


def write_recording(folder: Path, *records: bytes) -> str:
    path = folder / "hostile.mcap"
    path.write_bytes(MAGIC + record(1, text("ros2") + text("")) + b"".join(records))
    return str(path)


SCHEMA = record(3, struct.pack("<H", 1) + text("nav_msgs/msg/Odometry") + text("ros2msg") + struct.pack("<I", 0))
CHANNEL = record(4, struct.pack("<HH", 1, 1) + text("/uuv1/odom") + text("cdr") + struct.pack("<I", 0))
EMPTY = record(5, struct.pack("<HIQQ", 1, 0, 0, 0))  # a message without content


def test_a_chunk_of_huge_declared_size_is_refused(tmp_path: Path) -> None:
    path = write_recording(tmp_path, chunk(zeros(256 * MIB), 2048 * MIB))
    assert Path(path).stat().st_size < 70_000
    with pytest.raises(ConfigError, match=r"hostile\.mcap: a chunk of 2048 MiB, where a recording has at most 128 MiB"):
        list(read_messages(path))


@pytest.mark.parametrize(
    ("packing", "pack"), [("zstd", zeros), ("lz4", lambda size: lz4.frame.compress(bytes(size)))], ids=["zstd", "lz4"]
)
def test_a_chunk_larger_than_declared_is_refused(tmp_path: Path, packing: str, pack: Callable[[int], bytes]) -> None:
    path = write_recording(tmp_path, chunk(pack(64 * MIB), 1000, packing))
    with pytest.raises(ConfigError, match="a chunk that is larger than it says"):
        list(read_messages(path))


def test_a_recording_that_unpacks_to_a_thousandfold_is_refused(tmp_path: Path) -> None:
    private = record(0x80, bytes(32 * MIB))  # of a kind that is passed over
    path = write_recording(tmp_path, *[chunk(zstandard.compress(private), len(private))] * 20)
    with pytest.raises(ConfigError, match="unpacks to more than 1000 times its size"):
        list(read_messages(path))


def test_lengths_beyond_the_file_are_treated_as_truncation(tmp_path: Path) -> None:
    recording = write_recording(tmp_path, SCHEMA, CHANNEL, EMPTY)
    for tail in (
        struct.pack("<BQ", 5, 1 << 63), struct.pack("<BQ", 5, 1 << 27), struct.pack("<BQ", 6, 40) + b"\xff" * 40,
        record(4, b"\xff" * 100), record(6, struct.pack("<QQQI", 0, 0, 9, 0) + text("rot13") + bytes(8)),
    ):  # fmt: skip
        Path(recording).write_bytes(Path(recording).read_bytes() + tail)
        assert len(list(read_messages(recording))) == 1


def test_attachments_are_bounded(tmp_path: Path) -> None:
    def attached(name: str, data: bytes) -> bytes:
        return record(9, bytes(16) + text(name) + text("") + struct.pack("<Q", len(data)) + data + bytes(4))

    assert read_about(write_recording(tmp_path, attached("a.toml", b"x"))).attachments == {"a.toml": "x"}
    for parts in ([attached("a.toml", bytes(17 * MIB))], [attached(f"{i}", b"") for i in range(70)]):
        with pytest.raises(ConfigError, match="more than 64 files are attached, or one of more than 16 MiB"):
            read_about(write_recording(tmp_path, *parts))


def test_rows_are_thinned_to_a_maximum_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_data, "MAX_ROWS", 100)
    rows = Rows()
    for number in range(10_000):
        rows.append((float(number),))
        assert len(rows) <= 100
    steps = {after[0] - before[0] for before, after in pairwise(rows)}
    assert len(steps) == 1, "evenly over the whole time"
    assert rows[0] == (0.0,)
    assert rows[-1][0] > 9_000


def test_more_vehicles_than_a_figure_can_show_are_refused() -> None:
    twist = ros.encode_twist((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    messages = [Message(f"/uuv{n}/cmd_vel", "geometry_msgs/msg/Twist", 1, 1, 1, twist) for n in range(70)]
    assert len(collect(messages[:64], "x")) == 64
    with pytest.raises(ConfigError, match="x: has more than 64 vehicles"):
        collect(messages, "x")


def test_plot_takes_little_memory_for_a_small_file(tmp_path: Path) -> None:
    """The 70 kB hold a chunk of messages without content, each of which was an object: they took 2.1 GB."""
    count = 120 * MIB // len(EMPTY)
    packer = zstandard.ZstdCompressor().compressobj()
    packed = packer.compress(SCHEMA + CHANNEL)
    packed += b"".join([packer.compress(EMPTY * 10_000) for _ in range(count // 10_000)]) + packer.flush()
    size = len(SCHEMA + CHANNEL) + count // 10_000 * 10_000 * len(EMPTY)
    path = write_recording(tmp_path, chunk(packed, size))
    assert Path(path).stat().st_size < 70_000
    code = (
        "import re, sys; from hil.cli import main; code = main(['recording', 'plot', sys.argv[1]]); "
        r"print(re.search(r'VmHWM:\s+(\d+)', open('/proc/self/status').read())[1]); sys.exit(code)"
    )  # ru_maxrss would count the process that has started this one
    completed = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True, timeout=250)
    assert completed.returncode == 2, completed.stderr
    (line,) = completed.stderr.splitlines()
    assert "hostile.mcap: " in line
    assert int(completed.stdout) < 500_000, "kB"
