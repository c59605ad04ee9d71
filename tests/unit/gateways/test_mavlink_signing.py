"""A ground station sets the key with which packets are signed."""

import stat
from hashlib import sha256
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.gateways.mavlink.endpoints.peer import Peer
from hil.gateways.mavlink.protocols.signing import SigningKey
from hil.links.contract import Counters
from hil.links.mavlink.stream import MavlinkStream
from tests.support.clients.mavlink_vehicle import Bench, Partner

KEY = bytes(range(1, 33))
WALL_NS = 1_800_000_000 * 10**9
BEAT = dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_GCS, 8, 0, 0, 0, 3)


def setup_message(key: bytes) -> dialect.MAVLink_message:
    return dialect.MAVLink_setup_signing_message(1, 1, list(key), 0)


def signed_stream(key: bytes = KEY) -> MavlinkStream:
    stream = MavlinkStream(255, 190, Counters())
    stream.sign(key, lambda: WALL_NS)
    return stream


def bench_with(signing: SigningKey) -> Bench:
    bench = Bench()
    bench.dispatcher.signing = signing
    return bench


def is_received(partner: Partner, packet: bytes) -> bool:
    return bool(partner.peer.unpack(packet))


def test_a_key_applies_to_all_and_is_saved_until_zeroed(tmp_path: Path) -> None:
    path = tmp_path / "state" / "mavlink-uuv1.toml.key"
    bench = bench_with(SigningKey(str(path)))
    other = bench.add_partner(254)
    bench.partner.send(setup_message(KEY))
    unsigned, right = MavlinkStream(255, 190, Counters()), signed_stream()
    for partner in (bench.partner, other):
        assert not is_received(partner, unsigned.pack(BEAT)), "an unsigned packet was accepted"
        assert is_received(partner, right.pack(BEAT))
        assert not is_received(partner, signed_stream(bytes(32 * [7])).pack(BEAT)), (
            "a packet signed with another key was accepted"
        )
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert SigningKey(str(path)).secret == KEY
    for packet in bench.partner.peer.unpack(right.pack(setup_message(bytes(32)))):
        bench.dispatcher.handle(bench.partner.peer, packet, bench.now)
    assert is_received(other, unsigned.pack(BEAT)), "a key of zeros ends signing"
    assert not path.exists()
    assert SigningKey(str(path)).secret == b""


def test_setting_a_key_without_permission_is_refused_with_a_reason(tmp_path: Path) -> None:
    path = tmp_path / "key"
    bench = bench_with(SigningKey(str(path)))
    bench.arm()
    bench.partner.send(setup_message(KEY))
    bench.run(0.1)
    assert "armed" in bench.partner.texts()
    bench.core.disarm()
    bench.partner.peer.is_local = False
    bench.partner.send(setup_message(KEY))
    bench.run(0.1)
    assert "this machine" in bench.partner.texts()
    looker = bench.add_partner(may_command=False)
    looker.send(setup_message(KEY))
    bench.dispatcher.signing = SigningKey(str(path), given="passphrase")
    bench.partner.peer.is_local = True
    bench.partner.send(setup_message(KEY))
    bench.run(0.1)
    assert "scenario" in bench.partner.texts()
    assert is_received(bench.partner, MavlinkStream(255, 190, Counters()).pack(BEAT))
    assert not path.exists()


@pytest.mark.parametrize("stored", ["", "no key", "ab" * 31, "zz" * 32])
def test_an_invalid_saved_key_is_ignored(tmp_path: Path, stored: str) -> None:
    path = tmp_path / "key"
    path.write_text(stored)
    assert SigningKey(str(path)).secret == b""


def test_a_key_that_cannot_be_saved_is_used_and_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    signing = SigningKey(str(tmp_path / "file" / "key"))
    assert "not stored" in signing.set(KEY)
    assert signing.secret == KEY


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
        signing.close()
    later = SigningKey(path, given="passphrase")
    assert not peer_with(later, 1, 40.0).unpack(arm), "it was accepted again after a restart"
    sender = MavlinkStream(255, 190, Counters())
    sender.sign(later.secret, lambda: WALL_NS + 11 * 10**9)
    assert peer_with(later, 1, 11.0).unpack(sender.pack(BEAT)), "a new packet is accepted"
    other = SigningKey(path, given="another")
    assert peer_with(other, 1).unpack(signed_stream(other.secret).pack(BEAT)), "another key has stamps of its own"


@pytest.mark.parametrize("stored", ["", "no stamps", "{key}\n1 2", "{key}\n0 255 190 9999999999999999999 1"])
def test_damaged_stamps_are_ignored(tmp_path: Path, stored: str) -> None:
    signing = SigningKey(str(tmp_path / "key"), given="passphrase")
    (tmp_path / "key.stamps").write_text(stored.replace("{key}", sha256(signing.secret).hexdigest()[:16]))
    again = SigningKey(str(tmp_path / "key"), given="passphrase")
    assert peer_with(again, 1).unpack(signed_stream(again.secret).pack(BEAT))


def test_two_peers_get_packets_under_links_of_their_own() -> None:
    sent: list[bytes] = []
    signing = SigningKey(given="passphrase")
    for number in (1, 2):
        peer = Peer(number, "", 1, lambda data, _: sent.append(data), True, signing=signing, wall_clock=lambda: WALL_NS)
        peer.send(BEAT)
    assert [packet[-13] for packet in sent] == [1, 2]
