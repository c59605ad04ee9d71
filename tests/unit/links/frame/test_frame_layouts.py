"""Layouts of frame files beyond the shipped ones, each compared with bytes written by hand."""

from pathlib import Path

import pytest

from hil.common.errors import ConfigError
from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from hil.links.frame.ends import KeepAlive
from hil.links.frame.layout import Other
from hil.links.frame.protocol import FrameProtocol
from hil.links.protocols import Role

PULSES = '{ name = "pwm_us", type = "u16" }'


def lab(folder: Path, text: str, role: Role | None = None) -> FrameProtocol:
    path = folder / "lab.toml"
    path.write_text(text)
    return FrameProtocol(str(path), role)


def frame_file(command: str, telemetry: str = PULSES, top: str = "", header: str = '{ name = "length" }') -> str:
    return f"""
byte_order = "little"
{top if "sync" in top else "sync = [0x7B]" + chr(10) + top}
header = [{header}]
[command]
fields = [{command}]
[telemetry]
fields = [{telemetry}]
"""


def test_without_an_id_each_end_decodes_the_others_messages(tmp_path: Path) -> None:
    text = frame_file(PULSES, top='checksum = { type = "xor8" }')
    host, device = lab(tmp_path, text, "host"), lab(tmp_path, text, "device")
    data = host.encode(ThrusterCommand(0, True, (1500, 1600)))
    assert data.hex(" ") == "7b 04 dc 05 40 06 9b"
    assert device.feed(data) == [ThrusterCommand(0, True, (1500, 1600))]
    assert host.feed(data) == [ThrusterTelemetry(0, True, False, (1500, 1600), 0, 0, 0, 0)]
    with pytest.raises(ConfigError, match=r"lab.toml: command and telemetry look alike: give them an id"):
        lab(tmp_path, text)


def test_a_sequence_may_lie_between_length_and_id(tmp_path: Path) -> None:
    """The constants of the header are not contiguous in MAVLink's layout."""
    header = '{ name = "length" }, { name = "sequence" }, { name = "id" }'
    text = (
        frame_file(PULSES, header=header)
        .replace("[command]", "[command]\nid = 1")
        .replace("[telemetry]", "[telemetry]\nid = 2")
    )
    protocol = lab(tmp_path, text)
    command, report = ThrusterCommand(200, True, (1500,)), ThrusterTelemetry(200, True, False, (1500,), 0, 0, 0, 0)
    assert protocol.encode(command)[:-2].hex(" ") == "7b 02 c8 01 dc 05"
    assert protocol.encode(report)[:-2].hex(" ") == "7b 02 c8 02 dc 05"
    data = protocol.encode(command) + protocol.encode(report)
    assert [m for i in range(len(data)) for m in protocol.feed(data[i : i + 1])] == [command, report]
    assert protocol.echoes_sequence
    unknown = lab(tmp_path, text.replace("id = 2", "id = 9")).encode(report)
    assert protocol.feed(unknown) == []
    assert (protocol.counters.malformed, protocol.counters.dropped_bytes) == (1, 0)


def test_a_count_field_gives_the_number_of_channels(tmp_path: Path) -> None:
    fields = f'{{ name = "sequence" }}, {{ name = "count" }}, {PULSES}'
    text = frame_file(fields, fields, header='{ name = "id" }')
    text = text.replace("[command]", "[command]\nid = 1").replace("[telemetry]", "[telemetry]\nid = 2")
    protocol = lab(tmp_path, text)
    for count in (1, 5, 16):
        command = ThrusterCommand(9, True, (1500,) * count)
        data = protocol.encode(command)
        assert data[:4] == bytes([0x7B, 1, 9, count])
        assert protocol.feed(data[:3]) == []
        assert protocol.feed(data[3:]) == [command]
    with pytest.raises(ConfigError, match="command: pwm_us needs its number of channels"):
        lab(tmp_path, text.replace('{ name = "count" }, ', ""))


def test_a_tail_and_a_checksum_over_part_of_the_frame_are_supported(tmp_path: Path) -> None:
    top = 'tail = [0x0D, 0x0A]\nchecksum = { type = "sum8-twos-complement", start = "payload", omit_last = 1 }'
    command = f'{PULSES}, {{ name = "end", value = 0x7D }}'
    protocol = lab(tmp_path, frame_file(command, top=top))
    data = protocol.encode(ThrusterCommand(0, True, (0x0102,)))
    assert data.hex(" ") == "7b 03 02 01 7d fd 0d 0a"
    assert protocol.feed(data) == [ThrusterCommand(0, True, (0x0102,))]
    for damaged in (data[:-1] + b"\x0b", data[:4] + b"\x7c" + data[5:]):
        assert protocol.feed(damaged) == []
    assert protocol.counters.malformed == 1, "the constant was wrong, which the checksum does not cover"


def test_a_crc_can_be_given_by_its_parameters(tmp_path: Path) -> None:
    """CRC-8/NRSC-5 (check value 0xF7), which has no name here, over "123456789"."""
    top = 'sync = [0x31]\nchecksum = { type = "crc8", start = "sync", polynomial = 0x31, start_value = 0xFF }'
    fields = '{ name = "pwm_us", channels = 8 }'
    protocol = lab(tmp_path, frame_file(fields, fields + ', { name = "pad" }', top=top, header=""), "host")
    assert protocol.encode(ThrusterCommand(0, True, tuple(b"23456789"))) == b"123456789\xf7"


def test_lists_may_be_consecutive_or_alternating(tmp_path: Path) -> None:
    lists = '{ name = "pwm_us", type = "u16" }, { name = "current", extra = true, per_channel = true }'
    reference = lab(tmp_path, frame_file(PULSES, '{ name = "pad" }, ' + lists), "host")
    report = ThrusterTelemetry(0, True, False, (0x0102, 0x0304), 0, 0, 0, 0)
    assert reference.encode(report)[:-2].hex(" ") == "7b 07 00 02 01 04 03 00 00"
    text = frame_file(PULSES, '{ name = "pad" }, ' + lists).replace("[telemetry]", "[telemetry]\ninterleaved = true")
    mixed = lab(tmp_path, text, "host")
    assert mixed.encode(report)[:-2].hex(" ") == "7b 07 00 02 01 00 04 03 00"
    assert reference.feed(reference.encode(report)) == mixed.feed(mixed.encode(report)) == [report]


@pytest.mark.parametrize(
    ("keys", "pulses", "payload"),
    [
        ('type = "i16", unit = "normalised", scale = 0.001', (1100, 1500, 1900), "18 fc 00 00 e8 03"),
        ('type = "i16", unit = "normalised", scale = -0.001', (1100, 1500, 1900), "e8 03 00 00 18 fc"),
        ('type = "u16", unit = "normalised", scale = 0.001, offset = -1', (1100, 1500, 1900), "00 00 e8 03 d0 07"),
        ('type = "i16", unit = "rpm", full_scale = 3000', (1100, 1501, 1900), "48 f4 08 00 b8 0b"),
        ('type = "i32", unit = "N", full_scale = 50, scale = 0.01', (1100, 1500), "78 ec ff ff 00 00 00 00"),
        ('type = "f32", unit = "normalised", full_scale = 2', (1300, 1900), "00 00 80 bf 00 00 00 40"),
        ('type = "f32", unit = "normalised"', (1300, 1900), "00 00 00 bf 00 00 80 3f"),
        ('type = "f32"', (1500, 1100), "00 80 bb 44 00 80 89 44"),
        ('type = "u16", scale = 0.1', (1500, 1900), "98 3a 38 4a"),
        ('type = "i8", unit = "normalised", scale = 0.01', (1100, 1900), "9c 64"),
    ],
)
def test_thruster_values_may_have_other_units(tmp_path: Path, keys: str, pulses: tuple[int, ...], payload: str) -> None:
    protocol = lab(tmp_path, frame_file(f'{{ name = "pwm_us", {keys} }}'), "device")
    data = protocol.encode(ThrusterCommand(0, True, pulses))
    assert data[2:-2].hex(" ") == payload
    assert protocol.feed(data) == [ThrusterCommand(0, True, pulses)]


def test_a_scaled_number_stops_at_the_limit_of_its_type(tmp_path: Path) -> None:
    text = frame_file('{ name = "pwm_us", type = "i8", unit = "normalised", scale = 0.01 }')
    protocol = lab(tmp_path, text, "device")
    data = protocol.encode(ThrusterCommand(0, True, (-70_000, 70_000)))
    assert data[2:-2].hex(" ") == "80 7f"
    assert protocol.feed(data) == [ThrusterCommand(0, True, (988, 2008))]


@pytest.mark.parametrize("kind", ["slip", "hdlc"])
def test_delimiters_on_both_sides_separate_noise(tmp_path: Path, kind: str) -> None:
    top = f'sync = []\nstuffing = {{ type = "{kind}", delimit = "both" }}'
    protocol = lab(tmp_path, frame_file(PULSES, top=top, header=""), "device")
    command = ThrusterCommand(0, True, (0x7E7D, 0xC0DB, 1500))
    data = protocol.encode(command)
    delimiter = data[:1]
    assert data[-1:] == delimiter
    assert delimiter not in data[1:-1]
    assert protocol.feed(b"\x00\x7d" + data + data[1:] + b"\xdb" + data) == [command] * 3
    assert protocol.counters.dropped_bytes == 3


MISTAKES = [
    ('{ name = "voltage" }', ["'voltage'", "`value` (a constant) or `extra = true`"]),
    ('{ name = "voltage", type = "f32", value = 1 }', ["voltage cannot be f32"]),
    ('{ name = "kind", value = 300 }', ["kind: 300 does not fit in u8"]),
    ('{ name = "sequence", value = 3 }', ["sequence cannot have a value"]),
    ('{ name = "sequence", scale = 2 }', ["sequence cannot have scale or offset"]),
    ('{ name = "sequence", adds = 2 }', ["adds is for length and count"]),
    ('{ name = "sequence", per_channel = true }', ["per_channel is for extra fields"]),
    ('{ name = "sequence", unit = "s" }', ["unit is for pwm_us and extra fields"]),
    ('{ name = "sequence", full_scale = 2 }', ["full_scale is for pwm_us"]),
    ('{ name = "sequence", type = "f32" }', ["sequence cannot be f32"]),
    ('{ name = "count", adds = -10 }', ["count must hold -9, which u8 cannot"]),
    ('{ name = "volts", extra = true, scale = 0 }', ["scale 0"]),
    ('{ name = "length" }', ["'length' stands there twice"]),
]


@pytest.mark.parametrize(("field", "messages"), MISTAKES)
def test_a_mistake_in_a_field_is_reported(tmp_path: Path, field: str, messages: list[str]) -> None:
    with pytest.raises(ConfigError) as caught:
        lab(tmp_path, frame_file(f"{PULSES}, {field}"), "host")
    assert str(caught.value).startswith(f"{tmp_path}/lab.toml: ")
    assert all(word in str(caught.value) for word in messages), caught.value


@pytest.mark.parametrize(
    ("top", "messages"),
    [
        ("sync = []", ["sync", "no stuffing"]),
        ('checksum = { type = "sum8", polynomial = 7 }', ["sum8 has no polynomial"]),
        ('checksum = { type = "crc8", final_xor = 0x100 }', ["the 8 bits of crc8"]),
        ('checksum = { start = "flags" }', ["checksum: start: 'flags'", "payload, length"]),
        ('stuffing = { type = "cobs", escape = 3 }', ["for hdlc", "cobs has its own"]),
        ('stuffing = { type = "hdlc", escape = 0x7E }', ["must differ"]),
        ('stuffing = { type = "hdlc", xor = 3 }', ["xor 0x03", "another xor"]),
    ],
)
def test_a_mistake_at_the_top_level_is_reported(tmp_path: Path, top: str, messages: list[str]) -> None:
    with pytest.raises(ConfigError) as caught:
        lab(tmp_path, frame_file(PULSES, top=top), "host")
    assert all(word in str(caught.value) for word in messages), caught.value


@pytest.mark.parametrize(
    ("old", "new", "messages"),
    [
        ('unit = "rpm"', 'unit = "rps"', ["'rps' is not one of us, normalised, rpm, N"]),
        ('type = "u16" }', 'type = "u16", unit = "rpm" }', ["unit rpm needs full_scale", "in rpm"]),
        ("[telemetry]", "[telemetry]\nid = 3", ["telemetry: has an id, but the header has no 'id'"]),
        ("[telemetry]", '[[other]]\nname = "x"\nfields = [{ name = "pwm_us" }]\n[telemetry]', ["other[0]: 'pwm_us'"]),
        ("[telemetry]", '[[other]]\nsent_by = "me"\n[telemetry]', ["sent_by", "'me'", "host, device, both"]),
        ("[telemetry]", "[[other]]\nperiod = 5e-4\n[telemetry]", ["period", "0.001 to 3600 s"]),
    ],
)
def test_a_mistake_in_a_message_is_reported(tmp_path: Path, old: str, new: str, messages: list[str]) -> None:
    text = frame_file('{ name = "pwm_us", type = "i16", unit = "rpm", full_scale = 1000 }')
    assert old in text
    with pytest.raises(ConfigError) as caught:
        lab(tmp_path, text.replace(old, new, 1), "host")
    assert all(word in str(caught.value) for word in messages), caught.value


@pytest.mark.parametrize(
    ("pulse", "reported", "found"),
    [(799, 0, 5), (800, 800, 5), (2200, 2200, 5), (2201, 0, 5), (1600, 1500, 4), (1600, 1601, 0)],
)
def test_a_report_without_a_number_answers_the_command_with_its_pulses(
    tmp_path: Path, pulse: int, reported: int, found: int
) -> None:
    text = frame_file(PULSES)
    host, device = lab(tmp_path, text, "host"), lab(tmp_path, text, "device")
    for sequence, armed in ((4, False), (5, True)):
        host.encode(ThrusterCommand(sequence, armed, (pulse,)))
    (report,) = host.feed(device.encode(ThrusterTelemetry(0, True, False, (reported,), 0, 0, 0, 0)))
    assert (report.sequence, host.echoes_sequence) == (found, False)


@pytest.mark.parametrize("when_silent", [True, False])
def test_a_keep_alive_keeps_its_schedule_unless_it_was_late(when_silent: bool) -> None:
    """Its period is 20 ms while nothing else is sent, or 10 ms; a command goes out at 20, 40 and 50 ms."""
    beat = KeepAlive(Other(period=0.02 if when_silent else 0.01, when_silent=when_silent), b"beat")
    times_ms, found = (0, 5, 10, 20, 35, 40, 50, 60, 75, 85, 95, 105, 115, 125, 160, 168, 170), []
    for now_ms in times_ms:
        data = beat.tick(now_ms * 1_000_000)
        found += [now_ms] if data == b"beat" else []
        beat.is_needless |= now_ms in (20, 40, 50)
    assert found == ([0, 20, 40, 75, 95, 115, 160] if when_silent else [t for t in times_ms if t not in (5, 168)])
