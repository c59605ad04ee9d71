"""CAN buses behind a stream of text: adapters and servers, and their noise."""

from collections.abc import Iterator

import can
import pytest

from hil.links.address import open_address, wire_kind
from hil.links.wires.can_frame import pack_frame, unpack_frames
from hil.links.wires.faults import FaultyWire
from hil.links.wires.terminal import PtyHostWire, PtyWire, UartWire
from hil.links.wires.text_can_bus import SlcanWire
from tests.process.links.test_can_wire import EMPTY, EXTENDED, STANDARD, frame_of, message
from tests.support.links.can_pairs import until
from tests.support.links.link_contract import nothing_leaks, read_bytes, records, wait_readable
from tests.support.links.slcan_adapter import SlcanBus
from tests.support.links.socketcand_server import SocketcandServer


@pytest.fixture(autouse=True)
def _no_leaks() -> Iterator[None]:
    with nothing_leaks():
        yield


class TestSlcan:
    def test_an_adapter_is_set_up_and_closed(self) -> None:
        bus = SlcanBus(1)
        wire = SlcanWire(UartWire(bus.paths[0]), 500_000)
        assert wait_readable(wire)
        assert wire.read() == b"", "acknowledgements are no frames"
        wire.close()
        until(lambda: len(bus.output[0]) == 4)
        bus.close()
        assert bus.output == [[b"C", b"S6", b"O", b"C"]]

    def test_frames_are_exchanged_with_the_slcan_of_python_can(self) -> None:
        """python-can's own slcan is the other end."""
        bus = SlcanBus(2)
        wire = SlcanWire(UartWire(bus.paths[0]))
        adapter = can.Bus(bus.paths[1], "slcan", bitrate=1_000_000, sleep_after_open=0.0, ignore_config=True)
        until(lambda: bus.output[0][-1:] == [b"O"] and bus.output[1].count(b"O") == 2)
        wire.read()
        for frame in (STANDARD, EXTENDED, EMPTY):
            wire.write(pack_frame(frame))
            assert frame_of(adapter.recv(2.0)) == frame
            adapter.send(message(frame))
            assert list(unpack_frames(read_bytes(wire, 16))) == [frame]
        adapter.shutdown()
        wire.close()
        bus.close()

    def test_a_full_line_cuts_no_frame(self) -> None:
        adapter = PtyWire()
        wire = SlcanWire(PtyHostWire(adapter.path))
        numbered = records(bytes(8) * 2000, 0)
        written = wire.write(numbered)
        assert 0 < written < len(numbered)
        text = read_bytes(adapter, 1 << 20, 0.1)
        wire.read()  # a loop does
        text += read_bytes(adapter, 1 << 20, 0.1)
        *lines, rest = text.split(b"\r")
        assert rest == b""
        assert lines[4:] == [b"T%08X8%016X" % (number, 0) for number in range(written // 16)]
        wire.close()
        adapter.close()

    def test_all_received_frames_are_discarded_even_if_one_read_cannot_return_them(self) -> None:
        line = PtyWire()
        wire, adapter = SlcanWire(line), PtyHostWire(line.path)
        text = b"z\r" * 2048 + b"T%08X8%016X\r" % (7, 0) * 200
        assert adapter.write(text) == len(text)
        line._arrivals.unregister(line.terminal)  # as if the kernel's thread had not delivered it yet
        assert wire.discard_received() == len(text)
        adapter.close()
        wire.close()

    def test_faults_can_be_injected(self) -> None:
        adapter = PtyWire()
        wire = FaultyWire(SlcanWire(PtyHostWire(adapter.path)))
        assert wire.record_size == 16
        wire.write(pack_frame(STANDARD))
        assert read_bytes(adapter, 20) == b"\rC\rS8\rO\rt7FF3010203\r"
        wire.close()
        adapter.close()


class TestSocketcand:
    def test_frames_are_exchanged_with_the_socketcand_of_python_can(self) -> None:
        server = SocketcandServer()
        wire = open_address(f"can:socketcand:127.0.0.1:{server.port}", "host")
        with can.Bus("can0", "socketcand", host="127.0.0.1", port=server.port, ignore_config=True) as other_bus:
            until(lambda: len(server.clients) == 2)
            for frame in (STANDARD, EXTENDED, EMPTY):
                wire.write(pack_frame(frame))
                assert frame_of(other_bus.recv(2.0)) == frame
                other_bus.send(message(frame))
                assert unpack_frames(read_bytes(wire, 16)) == [frame]
        assert wire_kind(wire.name) == "can"
        wire.close()
        server.close()
        assert server.opened == ["can0", "can0"]
