"""Packets are signed with the key of the scenario, and accepted once."""

from hashlib import sha256
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.gateways.mavlink.peer import Peer
from hil.gateways.mavlink.protocols.signing import SigningKey
from hil.links.contract import Counters
from hil.links.mavlink.stream import MavlinkStream

KEY = bytes(range(1, 33))
WALL_NS = 1_800_000_000 * 10**9
BEAT = dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_GCS, 8, 0, 0, 0, 3)


def signed_stream(key: bytes = KEY) -> MavlinkStream:
    stream = MavlinkStream(255, 190, Counters())
    stream.sign(key, lambda: WALL_NS)
    return stream


def peer_with(signing: SigningKey, number: int, seconds: float = 0.0) -> Peer:
    return Peer(
        number, "peer", 1, lambda *_: None, True, signing=signing, wall_clock=lambda: WALL_NS + int(seconds * 1e9)
    )


@pytest.mark.parametrize("crashes", [False, True])
def test_a_recorded_packet_is_refused_from_every_peer_and_after_a_restart(tmp_path: Path, crashes: bool) -> None:
    path = str(tmp_path / "key")
    signing = SigningKey(path, given="passphrase")
    arm = signed_stream(signing.secret).pack(dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    assert peer_with(signing, 1).unpack(arm)
    assert not peer_with(signing, 2, 20.0).unpack(arm), "it was accepted again from another port"
    if not crashes:
        signing.stamps.close()
    later = SigningKey(path, given="passphrase")
    assert not peer_with(later, 1, 40.0).unpack(arm), "it was accepted again after a restart"
    sender = MavlinkStream(255, 190, Counters())
    sender.sign(later.secret, lambda: WALL_NS + 11 * 10**9)
    assert peer_with(later, 1, 11.0).unpack(sender.pack(BEAT)), "a new packet is accepted"
    assert not peer_with(later, 1, 11.0).unpack(BEAT.pack(dialect.MAVLink(None, 255, 190))), "one without a signature"
    other = SigningKey(path, given="another")
    assert peer_with(other, 1).unpack(signed_stream(other.secret).pack(BEAT)), "another key has stamps of its own"


@pytest.mark.parametrize("stored", ["", "no stamps", "{key}\n1 2", "{key}\n0 255 190 9999999999999999999 1"])
def test_damaged_stamps_are_ignored(tmp_path: Path, stored: str) -> None:
    signing = SigningKey(str(tmp_path / "key"), given="passphrase")
    (tmp_path / "key.stamps").write_text(stored.replace("{key}", sha256(signing.secret).hexdigest()[:16]))
    again = SigningKey(str(tmp_path / "key"), given="passphrase")
    assert peer_with(again, 1).unpack(signed_stream(again.secret).pack(BEAT))


@pytest.mark.parametrize(("burst", "counts"), [(100, [5, 10, 12]), (10**6, [12] * 3), (0, [0] * 3)])
def test_a_list_is_sent_in_the_bursts_of_its_link(burst: int, counts: list[int]) -> None:
    sent: list[bytes] = []
    peer = Peer(1, "", 1, lambda data, _: sent.append(data), True, burst)
    for number, count in enumerate(counts):
        peer.send_later([BEAT] * 12 if number == 0 else [])
        assert len(sent) == count


def test_two_peers_get_packets_under_links_of_their_own() -> None:
    sent: list[bytes] = []
    signing = SigningKey(given="passphrase")
    for number in (1, 2):
        peer = Peer(number, "", 1, lambda data, _: sent.append(data), True, signing=signing, wall_clock=lambda: WALL_NS)
        peer.send(BEAT)
    assert [packet[-13] for packet in sent] == [1, 2]
