"""Endpoints of the MAVLink vehicle: UDP and TCP peers, the zenoh keys of BlueOS."""

import json
import socket
import time
from typing import Any

import pytest
import zenoh
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import NetworkError
from hil.gateways.mavlink.endpoints.links import HEARTBEATS_NS, MAX_PARTNERS, SILENT_NS, TcpIn, TcpOut, UdpIn, UdpOut
from hil.gateways.mavlink.endpoints.zenoh_link import ZenohLink
from tests.support.processes import PATIENCE_S, free_port, wait_for

BEAT = dialect.MAVLink_heartbeat_message(12, 3, 0, 19, 3, 3)
PACKET: bytes = BEAT.pack(dialect.MAVLink(None, 1, 1))


def test_udp_partners_are_served_until_they_time_out() -> None:
    link = UdpIn("127.0.0.1", 0)
    clients = [UdpOut("127.0.0.1", link.port) for _ in range(2)]
    try:
        for end in clients:
            end.send(end.partners()[0], PACKET, BEAT)
        assert wait_for(lambda: (link.receive(NS_PER_S) and len(link.partners()) == 2) or None)
        assert all(link.is_local(partner) for partner in link.partners())
        assert not link.is_local(("192.0.2.1", 14550))
        link.send(link.partners()[0], PACKET, BEAT)
        assert wait_for(lambda: clients[0].receive(0) or None) == [(clients[0].partners()[0], PACKET)]
        link.tick(100 * NS_PER_S)
        assert link.partners() == []
    finally:
        for one in (link, *clients):
            one.close()


def test_a_sender_of_noise_is_no_partner() -> None:
    link = UdpIn("127.0.0.1", 0)
    noise = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    noise.sendto(b"GET / HTTP/1.1", ("127.0.0.1", link.port))
    time.sleep(0.1)
    assert link.receive(0) == []
    assert link.partners() == []
    noise.close()
    link.close()


def test_partners_beyond_the_limit_are_refused_and_counted() -> None:
    """The connected peers stay connected."""
    datagrams, stream = UdpIn("127.0.0.1", 0), TcpIn("127.0.0.1", 0)
    clients = [UdpOut("127.0.0.1", datagrams.port) for _ in range(MAX_PARTNERS + 2)]
    links: list[socket.socket] = []
    try:
        for end in clients:
            end.send(end.partners()[0], PACKET, BEAT)
            assert wait_for(lambda: datagrams.receive(0) or datagrams.refused or None)
        for _ in range(MAX_PARTNERS + 2):
            links.append(socket.create_connection(("127.0.0.1", stream.port), PATIENCE_S))
            assert wait_for(lambda: stream.receive(0) or len(stream.partners()) + stream.refused == len(links) or None)
        assert (len(datagrams.partners()), len(stream.partners())) == (MAX_PARTNERS, MAX_PARTNERS)
        assert wait_for(lambda: datagrams.receive(0) or (datagrams.refused, stream.refused) == (2, 2) or None)
        first, later = datagrams.partners()[0], HEARTBEATS_NS + 1
        for end in clients[1:MAX_PARTNERS]:
            end.send(end.partners()[0], PACKET, BEAT)
            assert wait_for(lambda: datagrams.receive(later) or None)
        clients[-1].send(clients[-1].partners()[0], PACKET, BEAT)
        assert wait_for(lambda: datagrams.receive(later) or first not in datagrams.partners() or None)
        assert len(datagrams.partners()) == MAX_PARTNERS, "the longest silent one has made room"
    finally:
        for end in clients:
            end.close()
        for call in links:
            call.close()
        datagrams.close()
        stream.close()


def test_a_silent_tcp_connection_makes_room_for_another() -> None:
    """One that sends stays, however long the others are there."""
    stream, now = TcpIn("127.0.0.1", 0), 0
    calls: list[socket.socket] = []
    try:
        calls += [socket.create_connection(("127.0.0.1", stream.port), PATIENCE_S) for _ in range(MAX_PARTNERS)]
        assert wait_for(lambda: stream.receive(now) or len(stream.partners()) == MAX_PARTNERS or None)
        now = SILENT_NS + 1
        calls[0].sendall(PACKET)
        assert wait_for(lambda: stream.receive(now) or None)
        calls.append(socket.create_connection(("127.0.0.1", stream.port), PATIENCE_S))
        assert wait_for(lambda: stream.receive(now) or calls[-1].getsockname() in stream.partners() or None)
        assert calls[0].getsockname() in stream.partners()
        assert (len(stream.partners()), stream.refused) == (MAX_PARTNERS, 0)
    finally:
        for call in calls:
            call.close()
        stream.close()


def test_a_lost_tcp_connection_is_made_again() -> None:
    port = free_port()
    client = TcpOut("127.0.0.1", port)
    for _ in range(2):
        assert _exchange_packet(client, port), "a packet comes through"
        assert wait_for(lambda: client.receive(0) or not client.partners() or None), "and its end is seen"
    client.close()


def _exchange_packet(client: TcpOut, port: int) -> bool:
    """Return True if a packet reaches a peer, which then closes its connection."""
    server = TcpIn("127.0.0.1", port)

    def connect() -> Any:
        client.tick(now_ns())
        server.receive(0)
        return client.partners() and server.partners()

    assert wait_for(connect)
    client.send(client.partners()[0], PACKET, BEAT)
    received = wait_for(lambda: server.receive(0) or None)
    server.close()
    return bool(received)


def test_a_port_in_use_is_named_in_the_error() -> None:
    link = TcpIn("127.0.0.1", 0)
    with pytest.raises(NetworkError, match=f"tcpin:127.0.0.1:{link.port}.*ArduSub"):
        TcpIn("127.0.0.1", link.port)
    link.close()
    with pytest.raises(NetworkError, match="udpout:no"):
        UdpOut("no.such.host.invalid", 1)


def test_packets_have_the_keys_and_json_of_blueos() -> None:
    port = free_port()
    where = f'listen: {{endpoints: ["tcp/127.0.0.1:{port}"]}}'
    config = zenoh.Config.from_json5(f'{{mode: "router", {where}, scouting: {{multicast: {{enabled: false}}}}}}')
    samples: dict[str, bytes] = {}
    with zenoh.open(config) as router:
        readers = [
            router.declare_subscriber(keys, zenoh.handlers.FifoChannel(1000))
            for keys in ("mavlink/**", "mavlink_raw/out")
        ]
        publisher, text_publisher = (router.declare_publisher(key) for key in ("mavlink_raw/in", "mavlink/in"))
        link = ZenohLink(f"tcp/127.0.0.1:{port}")

        def exchange() -> Any:
            link.send(link.partners()[0], PACKET, BEAT)
            publisher.put(PACKET)
            text_publisher.put(samples.get("mavlink/1/1/HEARTBEAT", b"{}"))
            time.sleep(0.05)
            for reader in readers:
                while (sample := reader.try_recv()) is not None:
                    samples[str(sample.key_expr)] = sample.payload.to_bytes()
            received = link.receive(0)
            return received if len(received) > 1 and "mavlink/1/1/HEARTBEAT/mavtype" in samples else None

        packets = [packet for _, packet in wait_for(exchange) or []]
        assert packets
        assert set(packets) == {PACKET}, "the JSON of a message makes the same packet"
        link.close()
    assert samples["mavlink_raw/out"] == PACKET
    message = json.loads(samples["mavlink/1/1/HEARTBEAT"])
    assert message["header"] == {"system_id": 1, "component_id": 1, "sequence": 0, "message_id": 0}
    assert message["message"] == {
        "type": "HEARTBEAT", "mavtype": {"type": "MAV_TYPE_SUBMARINE"}, "base_mode": {"bits": 0}, "custom_mode": 19,
        "autopilot": {"type": "MAV_AUTOPILOT_ARDUPILOTMEGA"}, "system_status": {"type": "MAV_STATE_STANDBY"},
        "mavlink_version": 3,
    }  # fmt: skip
    assert not link.is_local("zenoh")
