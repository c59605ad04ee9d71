"""Every shipped frame: golden bytes against an independent peer, and noise on the line."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_stub.stub import Stm32
from hil.common.schema import find_preset, preset_names
from hil.links.contract import Message, ThrusterCommand, ThrusterTelemetry
from hil.links.frame.protocol import FrameProtocol, open_frame
from tests.support.examples import examples
from tests.support.links.frame_peers import PEERS, cobs, crc32

FOLDER = "firmware_stub/frames"
NAMES = preset_names(FOLDER)
VECTORS = Path(__file__).parents[3] / "vectors"
GOLDEN = [
    pytest.param(frame, vector, id=f"{frame}: {vector['message']}, {vector['name']}")
    for frame in ("modbus_like", "aa55", "cobs_thrust")
    for vector in json.loads((VECTORS / f"{frame}_frames.json").read_text())["sound"]
]
# Pulses that every frame carries without loss.
pulses = st.lists(st.integers(1100, 1900), min_size=1, max_size=16).map(tuple)
commands = st.builds(ThrusterCommand, st.integers(0, 255), st.just(True), pulses)
PIECES = [b"\xaa\x55", b"\x01\x10\x01\x00\x00\x07\x0e", b"\x01\x03", b"\xa5\x5a\x10\x01", b"\x00", b"\x03\x43"]
noise = st.lists(st.one_of(st.binary(max_size=20), st.sampled_from(PIECES)), max_size=6).map(b"".join)


def opened(name: str) -> FrameProtocol:
    return FrameProtocol(find_preset(FOLDER, name))


def message_of(kind: str, fields: dict[str, Any]) -> Message:
    fields = {**fields, "pwm_us": tuple(fields["pwm_us"])}
    return ThrusterCommand(**fields) if kind == "command" else ThrusterTelemetry(**fields)


def lost(protocol: FrameProtocol) -> int:
    return protocol.counters.checksum_errors + protocol.counters.malformed + protocol.counters.dropped_bytes


def test_each_example_has_vectors() -> None:
    assert {path.name for path in VECTORS.glob("*_frames.json")} == {f"{name}_frames.json" for name in NAMES}


@pytest.mark.parametrize(("frame", "vector"), GOLDEN)
def test_frames_have_the_golden_bytes(frame: str, vector: dict[str, Any]) -> None:
    protocol, data, fields = opened(frame), bytes.fromhex(vector["hex"]), vector["fields"]
    sent = message_of(vector["message"], fields)
    rest = {key: value for key, value in fields.items() if key != "pwm_us"}
    assert PEERS[frame, vector["message"]](fields["pwm_us"], **rest) == data
    assert protocol.encode(sent).hex(" ") == vector["hex"]
    assert protocol.feed(data) == [message_of(vector["message"], fields | vector.get("heard", {}))]
    assert lost(protocol) == 0


@pytest.mark.parametrize("name", NAMES)
@examples(40)
@given(commands)
def test_commands_packed_by_the_peer_are_decoded(name: str, command: ThrusterCommand) -> None:
    host, device = open_frame("host", len(command.pwm_us), name), open_frame("device", len(command.pwm_us), name)
    data = host.encode(command)
    peer = PEERS.get((name, "command"))
    if peer:
        assert data == peer(command.pwm_us, sequence=command.sequence, armed=True)
    (received,) = device.feed(data)
    assert received._replace(sequence=command.sequence) == command


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=40, derandomize=True)  # a sum of 8 bits is right by chance once in 256
@given(st.lists(st.tuples(noise, commands), min_size=1, max_size=4), st.integers(1, 40))
def test_a_valid_frame_is_decoded_with_its_last_byte(
    name: str, stream: list[tuple[bytes, ThrusterCommand]], chunk: int
) -> None:
    """A frame is decoded with its last byte, whatever came before and however the bytes were split."""
    protocol, sender = opened(name), opened(name)
    for before, command in stream:
        data = before + sender.encode(command)
        received = [m for i in range(0, len(data), chunk) for m in protocol.feed(data[i : i + chunk])]
        assert [m.pwm_us for m in received] == [command.pwm_us]
        assert protocol.reader.unfinished == b""


@pytest.mark.parametrize("name", NAMES)
def test_a_frame_with_one_wrong_byte_is_never_accepted(name: str) -> None:
    """Every byte of a frame is replaced by every other value; the frame after it is always decoded at once."""
    protocol, valid = opened(name), ThrusterCommand(77, True, (1400, 1500, 1600))
    next_frame = protocol.encode(valid)
    for message in (
        ThrusterCommand(3, True, (1200, 1801)),
        ThrusterTelemetry(3, True, False, (1200, 1801), 500, 1, 2, 3),
    ):
        data = protocol.encode(message)
        for index in range(len(data)):
            for value in set(range(256)) - {data[index]}:
                received = protocol.feed(data[:index] + bytes([value]) + data[index + 1 :]) + protocol.feed(next_frame)
                assert [m.pwm_us for m in received] == [valid.pwm_us], (index, value)


@pytest.mark.parametrize("name", NAMES)
@examples(40)
@given(st.lists(st.one_of(st.binary(max_size=300), noise), max_size=8))
def test_every_byte_is_decoded_dropped_or_pending(name: str, chunks: list[bytes]) -> None:
    protocol = opened(name)
    understood = 0
    for chunk in chunks:
        for message in protocol.feed(chunk):
            understood += len(protocol.encode(message))
        assert len(protocol.reader.unfinished) <= 300
    data = b"".join(chunks)
    stuffed = protocol.layout.stuffing.type != "none"
    if (
        not protocol.counters.malformed and not understood
    ):  # these are valid frames of a size that this test does not compute
        delimiters = data.count(b"\0") if stuffed else 0
        assert protocol.counters.dropped_bytes + delimiters + len(protocol.reader.unfinished) == len(data)


@pytest.mark.parametrize("name", NAMES)
def test_a_report_names_the_command_that_it_acknowledges(name: str) -> None:
    """The STM32's twin replies, also past a wrap of the sequence number, whatever part of it the frame carries."""
    host, device, stm32 = open_frame("host", 4, name), open_frame("device", 4, name), Stm32(4)
    data, sequences = b"", list[int]()
    for number in range(65_500, 65_600):
        sequence = number % 65_536
        (command,) = device.feed(
            host.encode(ThrusterCommand(sequence, True, tuple(1100 + (number * 7 + i) % 800 for i in range(4))))
        )
        assert isinstance(command, ThrusterCommand)
        assert stm32.command(command, number * 20_000_000)
        late, data = data, device.encode(stm32.telemetry(number * 20_000_000))
        for report in host.feed(late + data):  # the one before comes again, after this command
            assert isinstance(report, ThrusterTelemetry)
            sequences.append((report.sequence - number) % 65_536)
    assert sequences == [0, *[65_535, 0] * 99]


@pytest.mark.parametrize("name", NAMES)
def test_a_disarmed_command_gives_neutral_pulses(name: str) -> None:
    """Disarmed is neutral, whether the frame has a bit for it or not."""
    device, stm32 = open_frame("device", 2, name), Stm32(2)
    (command,) = device.feed(open_frame("host", 2, name).encode(ThrusterCommand(9, False, (1900, 1100))))
    assert isinstance(command, ThrusterCommand)
    stm32.command(command, 0)
    assert stm32.pwm_us == [1500, 1500]


def test_modbus_requests_and_acknowledgements_are_ignored_by_their_receivers() -> None:
    """Both are ignored, and not counted as an error, by the end that receives them; the request has its count."""
    host, device = open_frame("host", 6, "modbus_like"), open_frame("device", 6, "modbus_like")
    assert host.deadline_ns == 0
    request = host.tick(0)
    assert request.hex(" ") == "01 03 02 00 00 0b 05 b5"
    assert host.deadline_ns == 20_000_000
    assert (host.tick(40_000_000), host.deadline_ns) == (request, 60_000_000), "one was left out"
    assert device.feed(request) == host.feed(bytes.fromhex("01 10 01 00 00 07 80 37")) == []
    assert lost(host) == lost(device) == 0
    assert device.deadline_ns > 1 << 62, "only the host sends keep-alives"


def test_a_keep_alive_is_sent_only_without_commands() -> None:
    host, device = open_frame("host", 2, "aa55"), open_frame("device", 2, "aa55")
    spoken, step, silence, longest = [], 5_000_000, 0, 0
    for now in range(0, 2_000_000_000, step):
        data = b""
        if now < 1_000_000_000 and now % 20_000_000 == 0:
            data = host.encode(ThrusterCommand(0, True, (1500, 1500)))
        elif now >= host.deadline_ns:
            data = host.tick(now)
            spoken += [now] if data else []
        silence = 0 if data else silence + step
        longest = max(longest, silence)
    assert longest <= 100_000_000
    assert len([now for now in spoken if 50_000_000 < now < 1_000_000_000]) == 0
    assert len([now for now in spoken if now >= 1_000_000_000]) == pytest.approx(10, abs=1)
    assert device.feed(b"\xaa\x55\x01\x00\x01") == []
    assert lost(device) == 0


def test_extra_fields_are_ignored() -> None:
    """A report with voltage, temperature and currents is a report like any other; a constant must be right."""
    data = bytearray(opened("aa55").encode(ThrusterTelemetry(1, True, False, (1600, 1400), 700, 0, 0, 0)))
    data[8:11] = b"\x80\x3e\xf6"  # 16 V, -10 degC
    data[13:15] = b"\x34\x12"
    data[-1] = sum(data[2:-1]) % 256
    protocol = opened("aa55")
    assert protocol.feed(bytes(data)) == [ThrusterTelemetry(1, True, False, (1600, 1400), 700, 0, 0, 0)]


def test_non_finite_floats_are_malformed() -> None:
    protocol = opened("cobs_thrust")
    for bad in (b"\0\0\xc0\x7f", b"\0\0\x80\x7f", b"\0\0\x80\xff"):
        assert protocol.feed(cobs(crc32(b"C\x01\x00" + bad))) == []
    assert (protocol.counters.malformed, protocol.counters.dropped_bytes) == (3, 0)
