"""CAN wires: other software on the bus, adapters and their noise, and errors when opening."""

import random
import select
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import can
import pytest

from hil.common.errors import DeviceError
from hil.links.contract import Wire
from hil.links.wires.can_bus import SocketCanWire, open_socketcan
from hil.links.wires.can_frame import ERROR, REMOTE, CanFrame, pack_frame, unpack_frames
from hil.links.wires.python_can_bus import DAMAGED, PythonCanWire, _record_of_message
from hil.links.wires.terminal import PtyWire
from tests.support.links.can_pairs import python_can_pair, socket_pair, until, virtual_pair
from tests.support.links.link_contract import EVERY_BYTE, PATIENCE_S, nothing_leaks, read_bytes, records, wait_readable

STANDARD = CanFrame(0x7FF, b"\x01\x02\x03", extended=False)
EXTENDED = CanFrame(0x1FFF_FFFF, bytes(range(8)))
EMPTY = CanFrame(0, b"", extended=False)


@pytest.fixture(autouse=True)
def _no_leaks() -> Iterator[None]:
    with nothing_leaks():
        yield


def message(frame: CanFrame) -> can.Message:
    return can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=frame.extended)


def frame_of(received: can.Message | None) -> CanFrame:
    assert received is not None
    return CanFrame(received.arbitration_id, bytes(received.data), received.is_extended_id)


def _read_for_ever(wire: Wire) -> None:
    while True:
        wire.read()


def receives_all_accepted_frames(device: Wire, host: Wire, frames: int) -> bool:
    """Send more than the bus can hold without a reader; return whether all accepted frames are received."""
    expected = records(bytes(8 * frames), 0)
    sent_bytes = 0
    for _ in range(4):
        sent_bytes += host.write(expected[sent_bytes:])
        time.sleep(0.03)  # longer than the reading thread's period
    assert 0 < sent_bytes < len(expected)
    return read_bytes(device, sent_bytes) == expected[:sent_bytes]


class TestSocketCan:
    def test_a_missing_interface_is_reported(self) -> None:
        """The error says so where the kernel has no CAN at all."""
        with pytest.raises(
            DeviceError, match=r"^can:socketcan:can77: (no such interface|this kernel has no CAN)"
        ) as caught:
            open_socketcan("can77")
        assert "sudo ip link set can77 up type can bitrate 1000000" in str(caught.value) or "modprobe" in str(
            caught.value
        )

    def test_bus_off_is_reported(self) -> None:
        device, host = socket_pair()
        device.write((ERROR | 0x40).to_bytes(4, sys.byteorder) + b"\x08" + bytes(11))
        with pytest.raises(DeviceError, match=r"bus-off: check wiring, .*sudo ip link set can0 up"):
            host.read()
        device.close()
        host.close()

    def test_one_read_gives_all_frames(self) -> None:
        device, host = socket_pair()
        sent = records(EVERY_BYTE)
        device.write(sent)
        assert host.read() == sent
        assert isinstance(host, SocketCanWire)
        device.close()
        host.close()


class TestVirtualCan:
    def test_frames_on_a_virtual_bus_can_be_read_at_once(self) -> None:
        """No thread has to wake up in between; the descriptor is readable exactly when there is a frame."""
        before = threading.active_count()
        device, host = virtual_pair()
        assert threading.active_count() == before
        for count in (1, 6, 256):
            expected = records(bytes(8 * count), 0)
            assert host.write(expected) == len(expected)
            assert select.select([device], [], [], 0)[0]
            assert device.read() == expected
            assert not select.select([device, host], [], [], 0)[0]
            assert device.read() == b""
        device.close()
        host.close()

    def test_a_closed_end_of_a_virtual_bus_does_not_block_others(self) -> None:
        device, host = virtual_pair()
        device.close()
        for _ in range(2):
            assert host.write(records(bytes(8 * 300), 0)) == 300 * 16
        host.close()
        with pytest.raises(DeviceError, match="is closed"):
            host.write(pack_frame(EXTENDED))

    def test_an_unread_bus_loses_no_accepted_frame(self) -> None:
        device, host = virtual_pair()
        assert receives_all_accepted_frames(device, host, frames=100_000)
        device.close()
        host.close()


class TestPythonCan:
    def test_frames_are_exchanged_with_python_can_on_a_virtual_bus(self) -> None:
        wire = PythonCanWire("virtual", "shared")
        with can.Bus("shared", "virtual", ignore_config=True) as other_bus:
            for frame in (STANDARD, EXTENDED, EMPTY):
                wire.write(pack_frame(frame))
                assert frame_of(other_bus.recv(2.0)) == frame
                other_bus.send(message(frame))
                assert list(unpack_frames(read_bytes(wire, 16))) == [frame]
        wire.close()

    def test_frames_other_than_classic_data_frames_are_ignored(self) -> None:
        wire = PythonCanWire("virtual", "mixed")
        with can.Bus("mixed", "virtual", ignore_config=True) as other_bus:
            other_bus.send(can.Message(arbitration_id=1, is_remote_frame=True, dlc=2))
            other_bus.send(can.Message(arbitration_id=2, is_error_frame=True))
            other_bus.send(can.Message(arbitration_id=3, is_fd=True, data=bytes(32)))
            other_bus.send(message(EXTENDED))
            assert read_bytes(wire, 16) == pack_frame(EXTENDED)
        wire.close()

    def test_only_data_frames_are_sent(self) -> None:
        device, host = python_can_pair()
        marks = b"".join((5 | mark).to_bytes(4, sys.byteorder) + bytes(12) for mark in (REMOTE, ERROR))
        assert host.write(marks + pack_frame(STANDARD)) == 48
        assert read_bytes(device, 48, 0.1) == pack_frame(STANDARD)
        device.close()
        host.close()

    def test_a_bus_without_descriptor_is_read_by_a_thread(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("hil.links.wires.python_can_bus._Reader.PERIOD_S", 2.0 * PATIENCE_S)
        device, host = python_can_pair()
        for _ in range(21):
            host.write(pack_frame(EXTENDED))
            assert wait_readable(device), "woken by the frame: its thread would look by itself only after the patience"
            assert device.read() == pack_frame(EXTENDED)
        monkeypatch.undo()
        for sender, receiver in ((host, device), (device, host)):  # so that both threads look at the period again
            sender.write(pack_frame(EXTENDED))
            assert read_bytes(receiver, 16) == pack_frame(EXTENDED)
        assert receives_all_accepted_frames(device, host, frames=2000)
        device.close()
        host.close()

    def test_all_frames_are_discarded_on_a_bus_without_descriptor(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Its thread has room for fewer frames than the bus."""
        device, host = python_can_pair()
        old, written = records(bytes(8 * 400), 0), 0
        until(lambda: device._reader._records.full() or not host.write(old[:16]))  # type: ignore[attr-defined]
        written += host.write(old)
        assert written
        assert device.discard_received() >= written
        new = pack_frame(EXTENDED)
        assert host.write(new) == len(new)
        assert read_bytes(device, len(new)) == new
        assert device.read() == b""
        device.close()
        host.close()

    @pytest.mark.parametrize("interface", ["serial", "robotell", "seeedstudio"])
    def test_noise_loses_no_later_frame(self, interface: str, monkeypatch: pytest.MonkeyPatch) -> None:
        """Of 30,000 bytes of noise some look like frames that the driver cannot decode."""
        monkeypatch.setattr("can.interfaces.robotell.robotellBus._writeconfig", lambda *_: None)  # waits for an answer
        adapter, other = PtyWire(), PtyWire()
        wire, sender = PythonCanWire(interface, adapter.path), PythonCanWire(interface, other.path)
        chance, noise = random.Random(1), 0
        while noise < 30_000:
            noise += adapter.write(chance.choice((b"", b"\xaa", b"\xaa\xaa")) + chance.randbytes(40))
            wire.read()
        sender.write(pack_frame(EXTENDED))
        text = read_bytes(other, 1000, 0.1)
        until(lambda: pack_frame(EXTENDED) in (adapter.write(text), wire.read())[1])
        for end in (wire, sender, adapter, other):
            end.close()

    def test_a_driver_that_fails_is_a_lost_device(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def fail(*_: object, **__: object) -> None:
            raise ValueError("a fault of the driver\n  and its traceback")

        device, host = python_can_pair()
        monkeypatch.setattr("can.interfaces.virtual.VirtualBus._recv_internal", fail)
        monkeypatch.setattr("can.interfaces.virtual.VirtualBus.send", fail)
        with pytest.raises(DeviceError, match=r"went away \(a fault of the driver\); reconnect it$"):
            _read_for_ever(device)
        with pytest.raises(DeviceError, match=r"went away \(a fault of the driver\)"):
            host.write(pack_frame(STANDARD))
        device.close()
        host.close()

    def test_python_can_is_not_imported_before_it_is_used(self) -> None:
        modules = "hil.links.address, hil.links.wires.can_bus, hil.links.wires.python_can_bus"
        code = f"import sys, {modules}; print('can' in sys.modules)"
        assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "False\n"


@pytest.mark.parametrize(
    ("number", "extended", "valid"),
    [(0x7FF, False, True), (0x800, False, False), (0x1FFF_FFFF, True, True), (0x2000_0000, True, False)],
)
def test_identifiers_have_11_or_29_bits(number: int, extended: bool, valid: bool) -> None:
    message = can.Message(arbitration_id=number, is_extended_id=extended, data=b"12", check=False)
    assert (_record_of_message(message) != DAMAGED) is valid
