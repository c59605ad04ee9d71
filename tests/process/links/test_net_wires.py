"""Network wires: peers that connect and disconnect, other senders, and errors when opening."""

import socket
from collections.abc import Iterator

import pytest

from hil.common.errors import DeviceError
from hil.links.wires import net
from hil.links.wires.net import TcpHostWire, TcpWire, UdpHostWire, UdpWire
from tests.support.links.link_contract import EVERY_BYTE, nothing_leaks, read_bytes, wait_readable

HOST = "127.0.0.1"


@pytest.fixture(autouse=True)
def _no_leaks() -> Iterator[None]:
    with nothing_leaks():
        yield


@pytest.fixture
def tcp() -> Iterator[TcpWire]:
    wire = TcpWire()
    yield wire
    wire.close()


@pytest.fixture
def udp() -> Iterator[UdpWire]:
    wire = UdpWire()
    yield wire
    wire.close()


class TestTcp:
    def test_peers_connect_and_disconnect(self, tcp: TcpWire) -> None:
        descriptor = tcp.fileno()
        for chunk in (b"one", b"two", b"three"):
            assert tcp.write(b"nobody is there") == 0
            host = TcpHostWire(HOST, tcp.port)
            host.write(chunk)
            assert read_bytes(tcp, len(chunk)) == chunk
            tcp.write(chunk)
            assert read_bytes(host, len(chunk)) == chunk
            host.close()
            assert wait_readable(tcp)
            assert tcp.read() == b""
            assert not wait_readable(tcp, 0), "a peer that went must not wake the loop for ever"
        assert tcp.fileno() == descriptor, "a loop may have registered it"

    def test_a_second_peer_is_disconnected(self, tcp: TcpWire) -> None:
        first, second = TcpHostWire(HOST, tcp.port), TcpHostWire(HOST, tcp.port)
        first.write(b"mine")
        assert read_bytes(tcp, 4) == b"mine"
        assert wait_readable(tcp)
        assert tcp.read() == b""
        assert wait_readable(second)
        with pytest.raises(DeviceError, match="went away"):
            second.read()
        assert not wait_readable(tcp, 0)
        tcp.write(b"still yours")
        assert read_bytes(first, 11) == b"still yours"
        first.close()
        second.close()

    def test_writing_to_a_closed_peer_writes_nothing(self, tcp: TcpWire) -> None:
        host = TcpHostWire(HOST, tcp.port)
        host.write(b"x")
        assert read_bytes(tcp, 1) == b"x"
        host.close()
        assert [tcp.write(b"telemetry") for _ in range(3)][-1] == 0

    def test_socket_options_send_at_once_and_limit_retries(self, tcp: TcpWire) -> None:
        host = TcpHostWire(HOST, tcp.port)
        with socket.socket(fileno=socket.dup(host.fileno())) as same:
            assert same.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
            assert same.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 2000
        host.close()

    def test_only_the_loopback_address_is_listened_on(self, tcp: TcpWire) -> None:
        with pytest.raises(DeviceError, match=rf"^tcp://127\.0\.0\.2:{tcp.port}: Connection refused; start"):
            TcpHostWire("127.0.0.2", tcp.port)

    def test_the_port_is_free_again_at_once(self) -> None:
        first = TcpWire()
        host = TcpHostWire(HOST, first.port)
        wait_readable(first)
        first.read()
        first.close()
        again = TcpWire(HOST, first.port)
        assert again.name == first.name
        again.close()
        host.close()


class TestUdp:
    def test_one_write_is_one_datagram(self, udp: UdpWire) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            peer.settimeout(60.0)
            peer.sendto(b"hello", (HOST, udp.port))
            assert read_bytes(udp, 5) == b"hello"
            for data in (b"one", EVERY_BYTE):
                udp.write(data)
                assert peer.recv(1000) == data

    def test_nothing_is_sent_before_a_peer_has_sent(self, udp: UdpWire) -> None:
        assert udp.write(b"telemetry") == 0
        host = UdpHostWire(HOST, udp.port)
        assert wait_readable(udp)
        assert udp.read() == b"", "the greeting is empty"
        assert udp.write(b"telemetry") == 9
        assert read_bytes(host, 9) == b"telemetry"
        host.close()

    def test_another_sender_is_ignored_until_the_first_times_out(
        self, udp: UdpWire, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        first, second = UdpHostWire(HOST, udp.port), UdpHostWire(HOST, udp.port)
        first.write(b"a")
        assert read_bytes(udp, 1) == b"a"
        second.write(b"b")
        assert wait_readable(udp)
        assert udp.read() == b""
        udp.write(b"for the first")
        assert read_bytes(first, 13) == b"for the first"
        monkeypatch.setattr(net, "PEER_TIMEOUT_S", 0.0)
        second.write(b"c")
        assert read_bytes(udp, 1) == b"c"
        udp.write(b"for the second")
        assert read_bytes(second, 14) == b"for the second"
        assert not wait_readable(first, 0)
        first.close()
        second.close()

    def test_the_host_receives_only_from_its_device(self, udp: UdpWire) -> None:
        host = UdpHostWire(HOST, udp.port)
        wait_readable(udp)
        udp.read()
        with (
            socket.socket(fileno=socket.dup(host.fileno())) as duplicate,
            socket.socket(type=socket.SOCK_DGRAM) as other_sender,
        ):
            other_sender.sendto(b"forged", duplicate.getsockname())
        udp.write(b"true")
        assert read_bytes(host, 4) == b"true"
        host.close()

    def test_a_restarted_device_is_received_again(self) -> None:
        device = UdpWire()
        host = UdpHostWire(HOST, device.port)
        device.close()
        for _ in range(5):
            assert host.write(b"anybody?") in (0, 8)
            assert host.read() == b""
        second_wire = UdpWire(HOST, device.port)
        while host.write(b"there") == 0:
            pass
        assert read_bytes(second_wire, 5) == b"there"
        host.close()
        second_wire.close()

    def test_many_datagrams_are_read_at_once(self, udp: UdpWire) -> None:
        host = UdpHostWire(HOST, udp.port)
        for byte in EVERY_BYTE[:20]:
            host.write(bytes([byte]))
        assert udp.read() == EVERY_BYTE[:20]
        host.close()

    def test_a_datagram_that_is_too_long_is_not_sent(self, udp: UdpWire) -> None:
        host = UdpHostWire(HOST, udp.port)
        assert host.write(bytes(70_000)) == 0
        host.close()
