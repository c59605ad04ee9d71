"""Properties of ptys and serial devices alone: names, locks, speeds, and every reason that they cannot be opened."""

import fcntl
import os
import select
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import serial

from hil.common.errors import DeviceError
from hil.links.contract import Counters, Wire
from hil.links.wires.faults import Faults, FaultyWire
from hil.links.wires.suspension import SuspendableWire
from hil.links.wires.terminal import READ_SIZE, UNREAD_LIMIT, PtyHostWire, PtyWire, UartWire, queued_bytes
from hil.links.wires.virtual_bus import VirtualCanWire
from tests.support.links.link_contract import PATIENCE_S, nothing_leaks, read_bytes, wait_readable


@pytest.fixture(autouse=True)
def _no_leaks() -> Iterator[None]:
    with nothing_leaks():
        yield


@pytest.fixture
def link_path(tmp_path: Path) -> Path:
    return tmp_path / "stm32"


def test_the_link_is_another_name_of_the_pty(link_path: Path) -> None:
    wire = PtyWire(str(link_path))
    assert wire.name == str(link_path)
    assert os.readlink(link_path) == wire.path
    host = PtyHostWire(str(link_path))
    with pytest.raises(DeviceError):
        PtyHostWire(str(link_path))
    host.write(b"hello")
    assert read_bytes(wire, 5) == b"hello"
    host.close()
    wire.close()
    assert (host.fileno(), host.terminal, wire.fileno()) == (-1, -1, -1)
    assert os.listdir(link_path.parent) == []


def test_one_process_at_a_time_holds_a_link_name(link_path: Path) -> None:
    first = PtyWire(str(link_path))
    with pytest.raises(DeviceError) as caught:
        PtyWire(str(link_path))
    assert str(link_path) in str(caught.value)
    assert "already served" in str(caught.value)
    assert os.readlink(link_path) == first.path, "the process that fails must not affect the one that succeeds"
    first.close()
    PtyWire(str(link_path)).close()


def test_a_link_name_is_never_held_twice(link_path: Path) -> None:
    """Many processes start and end at once: removing the lock file must not let two of them hold it."""
    holders, most, opened = 0, 0, 0
    guard = threading.Lock()

    def open_and_close() -> None:
        nonlocal holders, most, opened
        for _ in range(60):
            try:
                wire = PtyWire(str(link_path))
            except DeviceError:
                continue
            with guard:
                holders, opened = holders + 1, opened + 1
                most = max(most, holders)
            with guard:
                holders -= 1
            wire.close()

    threads = [threading.Thread(target=open_and_close) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert opened > 0
    assert most == 1
    assert os.listdir(link_path.parent) == []


def test_leftovers_of_a_killed_run_are_replaced(link_path: Path) -> None:
    link_path.symlink_to("/dev/pts/987654")
    link_path.with_name("stm32.new").symlink_to("/dev/pts/987653")
    link_path.with_name("stm32.lock").touch()
    wire = PtyWire(str(link_path))
    assert os.readlink(link_path) == wire.path
    wire.close()
    assert os.listdir(link_path.parent) == []


def test_files_of_others_are_not_replaced(link_path: Path) -> None:
    link_path.write_text("my thesis")
    with pytest.raises(DeviceError, match="not a link to a pty"):
        PtyWire(str(link_path))
    assert link_path.read_text() == "my thesis"
    link_path.unlink()
    link_path.symlink_to("/dev/null")  # as a udev name of a real port would be
    with pytest.raises(DeviceError, match="not a link to a pty"):
        PtyWire(str(link_path))
    assert os.readlink(link_path) == "/dev/null"
    assert os.listdir(link_path.parent) == ["stm32"]


def test_a_link_replaced_by_others_is_not_removed(link_path: Path) -> None:
    wire = PtyWire(str(link_path))
    link_path.unlink()
    link_path.write_text("not ours any more")
    wire.close()
    assert link_path.read_text() == "not ours any more"


def test_a_deleted_lock_file_does_not_release_the_next_holder(link_path: Path) -> None:
    first = PtyWire(str(link_path))
    lock = link_path.with_name("stm32.lock")
    lock.unlink()
    second = PtyWire(str(link_path))
    first.close()
    assert os.readlink(link_path) == second.path
    with pytest.raises(DeviceError, match="already served"):
        PtyWire(str(link_path))
    lock.unlink()
    second.close()
    assert os.listdir(link_path.parent) == []


def test_a_link_in_a_missing_folder_is_refused(tmp_path: Path) -> None:
    path = str(tmp_path / "nowhere" / "stm32")
    with pytest.raises(DeviceError, match="cannot be made: No such file or directory; choose another") as caught:
        PtyWire(path)
    assert str(caught.value).startswith(path)


@pytest.mark.parametrize("baud", [9600, 115_200, 921_600, 250_000, 123_456])
def test_the_device_reads_the_speed_that_the_host_set(baud: int) -> None:
    wire = PtyWire()
    with serial.Serial(wire.path, baud):
        assert wire.baud == baud
    wire.close()


def test_programs_may_open_and_close_the_port_repeatedly() -> None:
    wire = PtyWire()
    for chunk in (b"one", b"two"):
        with serial.Serial(wire.path, 115_200, timeout=PATIENCE_S) as program:
            program.write(chunk)
            assert read_bytes(wire, 3) == chunk
            wire.write(chunk)
            assert program.read(3) == chunk
        assert wire.read() == b""
    wire.close()


def wait_for_unread(wire: PtyWire, count: int) -> None:
    """Wait until the kernel has handed `count` bytes to the other end: it does so in a thread of its own."""
    end = os.open(wire.path, os.O_RDONLY | os.O_NOCTTY)
    deadline = time.monotonic() + PATIENCE_S
    try:
        while (unread := queued_bytes(end, termios.FIONREAD)) != count:
            assert time.monotonic() < deadline, f"{unread} bytes instead of {count}"
            time.sleep(0.0001)
    finally:
        os.close(end)


def fill(wire: PtyWire) -> int:
    """Write until the wire refuses, each time after the last bytes have arrived; return the bytes it took."""
    written_bytes = 0
    while taken := wire.write(b"o" * 32):
        written_bytes += taken
        assert written_bytes < 4096, "what a terminal holds"
        wait_for_unread(wire, written_bytes)
    return written_bytes


@pytest.mark.parametrize("open_host", [PtyHostWire, UartWire])
def test_a_terminal_without_bytes_is_not_read(
    open_host: Callable[[str], Wire], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Reading or polling one makes the kernel wait for a thread of normal priority, and a real-time loop with it."""
    with closing(PtyWire()) as device, closing(open_host(device.path)) as host:
        host.write(b"ping")
        assert read_bytes(device, 4) == b"ping"
        device.write(b"pong")
        assert read_bytes(host, 4) == b"pong"
        monkeypatch.setattr("hil.links.wires.terminal.os.read", lambda *_: b"asked")
        for end in (device, host):
            assert end.read() == b""
            assert not os.isatty(end.fileno()), "the descriptor that is waited on is no terminal"


@pytest.mark.parametrize("open_host", [PtyHostWire, UartWire])
def test_bytes_that_arrive_during_a_read_wake_the_reader_again(open_host: Callable[[str], Wire]) -> None:
    with closing(PtyWire()) as device, closing(open_host(device.path)) as host:
        sent = bytes(range(256)) * 16
        received, written_bytes = bytearray(), 0
        while len(received) < len(sent):
            written_bytes += host.write(sent[written_bytes : written_bytes + 7])
            received += device.read() if written_bytes < len(sent) else read_bytes(device, 1)
        assert bytes(received) == sent


def test_all_received_bytes_are_discarded_even_if_one_read_cannot_return_them() -> None:
    with closing(PtyWire()) as device, closing(PtyHostWire(device.path)) as host:
        written_bytes = 0
        while taken := host.write(bytes(1000)):
            written_bytes += taken
        assert written_bytes > 2 * READ_SIZE
        device._arrivals.unregister(device.terminal)  # as if the kernel's thread had not delivered them yet
        assert device.discard_received() == written_bytes


@pytest.mark.parametrize("delay", [0.0, 60.0])
def test_bytes_that_waited_while_their_reader_was_suspended_are_discarded(
    delay: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The reader was suspended just before its read; with a delay, the bytes are still in the simulated line then."""
    time_ns = 0
    monkeypatch.setattr("hil.links.wires.suspension.now_ns", lambda: time_ns)
    with closing(PtyWire()) as device, closing(PtyHostWire(device.path)) as host:
        faulty, counters = FaultyWire(device), Counters()
        with closing(SuspendableWire(faulty, 200, counters)) as wire:
            time_ns += 200
            host.write(b"in time")
            assert read_bytes(wire, 7) == b"in time"
            faulty.faults = Faults(delay=delay)
            host.write(b"before")
            assert wait_readable(wire)
            wire.read()
            host.write(b"meanwhile")
            assert wait_readable(wire)
            time_ns += 201
            assert wire.read() == b""
            assert counters.dropped_bytes == len(b"meanwhile") + (len(b"before") if delay else 0)
            faulty.faults = Faults()
            host.write(b"after")
            assert read_bytes(wire, 5) == b"after"


def test_a_wire_around_a_bus_keeps_its_records_and_what_it_tells() -> None:
    with closing(VirtualCanWire("records")) as bus, closing(SuspendableWire(FaultyWire(bus), 1, Counters())) as wire:
        assert (wire.record_size, wire.name, wire.fault_counts()[0]["chunks"]) == (16, "can:virtual:records", 0)
        assert wire.write(bytes(32)) == 32
        assert wire.fault_counts()[0]["chunks"] == 2


@pytest.mark.parametrize("open_host", [PtyHostWire, UartWire])
def test_each_read_after_a_hang_up_raises(open_host: Callable[[str], Wire]) -> None:
    device = PtyWire()
    with closing(open_host(device.path)) as host:
        device.close()
        for _ in range(3):
            assert select.select([host.fileno()], (), (), PATIENCE_S)[0], "a hang-up wakes"
            with pytest.raises(DeviceError, match="went away"):
                host.read()


@pytest.mark.parametrize("open_host", [PtyHostWire, UartWire])
def test_a_program_that_opens_the_port_reads_no_old_bytes(open_host: Callable[[str], Wire]) -> None:
    with closing(PtyWire()) as wire:
        assert fill(wire) == UNREAD_LIMIT
        with closing(open_host(wire.path)) as host:
            wire.write(b"new")
            assert read_bytes(host, 3) == b"new"


def test_reading_makes_room_for_new_bytes() -> None:
    with closing(PtyWire()) as wire, closing(PtyHostWire(wire.path)) as host:
        for frame in (b"%032d" % number for number in range(200)):
            assert wire.write(frame) == 32, "three times the limit, but never unread at once"
            assert read_bytes(host, 32) == frame
        kept = fill(wire)
        assert UNREAD_LIMIT <= kept < 2 * UNREAD_LIMIT
        assert read_bytes(host, kept) == b"o" * kept
        assert wire.write(b"new") == 3


@pytest.mark.parametrize("open_host", [PtyHostWire, UartWire])
class TestCannotOpen:
    """Devices that cannot be opened: each message is one line that names the device and what to do."""

    def failure(self, open_host: Callable[[str], Wire], path: object) -> str:
        with pytest.raises(DeviceError) as caught:
            open_host(str(path))
        message = str(caught.value)
        assert message.startswith(f"{path}: ")
        assert "\n" not in message
        return message

    def test_a_file_that_is_not_a_terminal_is_refused(self, open_host: Callable[[str], Wire], tmp_path: Path) -> None:
        file = tmp_path / "notes.txt"
        file.write_text("kept")
        self.failure(open_host, file)
        assert file.read_text() == "kept"


@pytest.mark.parametrize("call", ["__init__", "_reset_input_buffer"])
def test_a_device_unplugged_while_it_is_opened_is_reported(call: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pyserial's set-up finds no terminal any more, and so do we behind it; both give an error of their own."""
    device = PtyWire()
    step = getattr(serial.Serial, call)

    def write_and_unplug(port: serial.Serial, *arguments: Any, **options: Any) -> None:
        device.close()
        step(port, *arguments, **options)

    def open_and_unplug(port: serial.Serial, *arguments: Any, **options: Any) -> None:
        step(port, *arguments, **options)
        device.close()

    monkeypatch.setattr(serial.Serial, call, open_and_unplug if call == "__init__" else write_and_unplug)
    with pytest.raises(DeviceError, match=rf"^{device.path}: no device answers; is it plugged in"):
        UartWire(device.path)


def test_rs485_without_driver_support_is_refused() -> None:
    device = PtyWire()
    with pytest.raises(DeviceError, match=rf"^{device.path}: its driver has no RS-485 mode; use an adapter"):
        UartWire(device.path, rs485=True)
    UartWire(device.path).close()
    device.close()


def test_rs485_asks_the_driver_to_switch_direction(monkeypatch: pytest.MonkeyPatch) -> None:
    """The driver of a pty cannot; this one accepts TIOCGRS485 and TIOCSRS485 and is otherwise the pty's."""
    requested: list[tuple[int, bytes]] = []

    def driver(fd: int, request: int, *arguments: Any) -> Any:
        if request not in (0x542E, 0x542F):
            return ioctl(fd, request, *arguments)
        requested.append((request, bytes(arguments[0])))
        return 0

    ioctl = fcntl.ioctl
    monkeypatch.setattr(fcntl, "ioctl", driver)
    device = PtyWire()
    UartWire(device.path, rs485=True).close()
    device.close()
    request, settings = requested[-1]
    flags = int.from_bytes(settings[:4], sys.byteorder)
    enabled, rts_on_send, rts_after_send = 1, 2, 4  # linux/serial.h: struct serial_rs485
    assert request == 0x542F
    assert flags & (enabled | rts_on_send | rts_after_send) == enabled | rts_on_send
