"""CAN over UDP multicast: compatible with the public library, and robust against other senders."""

import json
import random
import socket
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from struct import pack
from typing import Any

import pytest

from hil.links.address import open_address
from hil.links.wires import multicast_bus
from hil.links.wires.can_frame import CanFrame, pack_frame, unpack_frames
from hil.links.wires.multicast_bus import PORT, MulticastCanWire
from tests.support.links.can_pairs import MCAST, mcast_pair, until
from tests.support.links.link_contract import nothing_leaks, read_bytes
from tests.support.network.multicast import require_multicast
from tests.support.processes import ROOT, Program

FRAMES = [CanFrame(0x1FFF_FFFF, bytes(range(8))), CanFrame(0x7FF, b"\x01\x02\x03", False), CanFrame(5, b"")]


def datagram(frame: CanFrame, flags: int = 0, magic: int = 0x2934) -> bytes:
    """Return a frame in the form that dronecan/driver/mcast.py sends."""
    common: Any = import_module("dronecan.dsdl.common")
    body = pack("<HI", flags, frame.id | frame.extended << 31) + frame.data
    return pack("<HH", magic, common.crc16_from_bytes(body)) + body


class OtherProgram:
    """Another program on the bus, by its socket."""

    def __init__(self) -> None:
        self.group = (f"239.65.82.{MCAST}", PORT)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        self.socket.connect(self.group)

    def send(self, data: bytes) -> None:
        self.socket.send(data)


def test_frames_have_the_bytes_of_the_public_library() -> None:
    require_multicast()
    with nothing_leaks():
        wire, program = open_address(f"can:mcast:{MCAST}", "host"), OtherProgram()
        for frame in FRAMES:
            program.send(datagram(frame))
            assert list(unpack_frames(read_bytes(wire, 16))) == [frame]
            assert multicast_bus._datagram_of_frame(frame) == datagram(frame)
        program.socket.close()
        wire.close()
        wire.close()


def test_two_ends_receive_each_other_and_not_themselves() -> None:
    with nothing_leaks():
        device, host = mcast_pair()
        sent = b"".join([pack_frame(frame) for frame in FRAMES])
        assert host.write(sent) == len(sent)
        assert read_bytes(device, len(sent)) == sent
        assert host.read() == b""
        device.close()
        host.close()


def test_noise_loses_no_frame() -> None:
    require_multicast()
    wire, program = MulticastCanWire(str(MCAST)), OtherProgram()
    source = random.Random(1)
    valid = FRAMES[0]
    damaged = bytearray(datagram(valid))
    damaged[-1] ^= 1
    noise = [
        bytes(damaged), datagram(valid, flags=1), datagram(valid, magic=0x1234), datagram(CanFrame(1, bytes(9))),
        datagram(CanFrame(1 << 30, b"")), b"", *[source.randbytes(source.randrange(90)) for _ in range(50)],
    ]  # fmt: skip
    for data in noise:
        program.send(data)
    program.send(datagram(valid))
    received = b""

    def is_there() -> bool:
        nonlocal received
        received += wire.read()
        return bool(received)

    until(is_there)
    assert list(unpack_frames(received)) == [valid]
    program.socket.close()
    wire.close()


def test_frames_of_other_machines_are_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    wire = MulticastCanWire(str(MCAST))
    assert wire._is_local("127.0.0.1")
    assert not wire._is_local("192.0.2.1")
    assert wire._out.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0
    wire.close()


def test_the_public_library_commands_the_emulated_stm32(tmp_path: Path) -> None:
    require_multicast()
    with Program(tmp_path, "stm32", "--protocol", "dronecan", "--port", f"can:mcast:{MCAST}"):
        command = [sys.executable, "-m", "tests.support.links.mcast_peer", f"mcast:{MCAST}"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=200, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout.splitlines()[-1])
    assert [report["speeds"][str(index)] for index in range(6)] == [3500, -3500, 0, 0, 0, 0]
    assert report["nodes"] == {"20": "org.uuv-hil.stm32"}
