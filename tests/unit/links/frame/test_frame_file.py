"""Frame files: another lab's layout works without code, and an invalid file is reported with its key."""

from pathlib import Path

import pytest

from hil.common.errors import ConfigError
from hil.common.schema import preset_folder, preset_names
from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from hil.links.frame.protocol import FrameProtocol

FRAMES = preset_folder("firmware_stub/frames")
LAYOUT = (Path(FRAMES) / "uuv_hil.toml").read_text()

# Fixed size, big-endian, id only, checksum over everything and low byte first, a signed age, padding.
FIXED = """
byte_order = "big"
sync = [0x47]
header = [{ name = "id", type = "u16" }]
checksum = { start = "sync", byte_order = "little" }
[command]
id = 0x0102
fields = [{ name = "pwm_us", type = "i16", channels = 2 }, { name = "sequence", type = "u8" }, { name = "pad" }]
[telemetry]
id = 0x0103
fields = [
  { name = "flags", bits = { timed_out = 7 } },
  { name = "pad", type = "u16" },
  { name = "pwm_us", type = "u16", channels = 2 },
  { name = "age_us", type = "i16" },
]
"""
# The id first, and a length that counts header, payload and checksum, but not the sync.
COUNTED = """
byte_order = "big"
sync = [0xFA, 0xFB, 0xFC]
header = [{ name = "id" }, { name = "length", type = "u16", adds = 5 }]
checksum = { start = "payload" }
[command]
id = 7
fields = [{ name = "pwm_us", type = "u32" }]
[telemetry]
id = 8
fields = [{ name = "sequence", type = "u32" }, { name = "pwm_us", type = "u8" }]
"""


def protocol(folder: Path, text: str) -> FrameProtocol:
    path = folder / "lab.toml"
    path.write_text(text)
    return FrameProtocol(str(path))


def test_a_fixed_size_frame_is_described(tmp_path: Path) -> None:
    lab = protocol(tmp_path, FIXED)
    assert lab.channels == [2]
    data = lab.encode(ThrusterCommand(513, True, (1500, -2)))
    assert data[:-2].hex(" ") == "47 01 02 05 dc ff fe 01 00"
    (received,) = lab.feed(data)
    assert received == ThrusterCommand(1, True, (1500, -2)), "no bit for it: armed; eight bits of sequence"
    assert lab.encode(ThrusterCommand(0, False, (1, 2))) == lab.encode(ThrusterCommand(0, True, (1500, 1500))), (
        "only neutral pulses can express disarmed"
    )
    data = lab.encode(ThrusterTelemetry(9, False, True, (1, 65535), 40_000, 1, 2, 3))
    assert data[:-2].hex(" ") == "47 01 03 80 00 00 00 01 ff ff 7f ff"
    assert lab.feed(b"\x47\x47" + data) == [ThrusterTelemetry(0, True, True, (1, 65535), 32767, 0, 0, 0)]
    assert lab.counters.dropped_bytes == 2


def test_a_length_may_count_more_than_the_payload(tmp_path: Path) -> None:
    lab = protocol(tmp_path, COUNTED)
    assert lab.channels == list(range(1, 17))
    data = lab.encode(ThrusterCommand(0, True, (1500, 1600)))
    assert data[:-2].hex(" ") == "fa fb fc 07 00 0d 00 00 05 dc 00 00 06 40"
    assert data[-2:] == lab.encode(ThrusterCommand(1, True, (1500, 1600)))[-2:]
    assert lab.feed(data) == [ThrusterCommand(0, True, (1500, 1600))]
    assert lab.feed(data[:5] + b"\x04" + data[6:]) == [], "shorter than its own header"
    assert lab.counters.dropped_bytes == len(data)
    assert lab.feed(data[:3] + b"\x63") == [], "of an unknown message, without its length yet"


@pytest.mark.parametrize("name", preset_names("firmware_stub/frames"))
def test_every_shipped_frame_loads(name: str) -> None:
    assert FrameProtocol(f"{FRAMES}/{name}.toml").channels


@pytest.mark.parametrize(
    ("old", "new", "messages"),
    [
        ("byte_order", "byteorder", ["'byteorder'", "did you mean 'byte_order'"]),
        ('"little"', '"middle"', ["byte_order", "'middle'", "little, big"]),
        ("sync = [0xA5, 0x5A]", "sync = []", ["sync", "at least one"]),
        ("sync = [0xA5, 0x5A]", "sync = [0x1A5]", ["sync[0]", "421", "0 to 255"]),
        ('"crc16-ccitt-false"', '"crc16-modbuss"', ["checksum: type", "'crc16-modbuss'", "crc16-modbus, "]),
        ('{ name = "id", type = "u8" },', "", ["header", "'id'"]),
        ('{ name = "id", type = "u8" }', '{ name = "age_us" }', ["header", "'age_us'", "id, "]),
        ("id = 0x02", "id = 0x01", ["same id"]),
        ("id = 0x02", "id = 0x102", ["id must hold 258", "u8"]),
        ('name = "pwm_us", type = "u16"', 'name = "pwm", type = "u16"', ["command: 'pwm'", "pwm_us", "extra = true"]),
        ('{ name = "pwm_us", type = "u16" },', "", ["command", "has no pwm_us"]),
        ('type = "u16" },\n  { name = "flags"', 'type = "f16" },\n  { name = "flags"', ["fields[0]: type", "u16"]),
        ("{ armed = 0 }", "{ armd = 0 }", ["'armd'", "did you mean 'armed'"]),
        ("{ armed = 0 }", "{ armed = 8 }", ["command", "flags of type u8", "bits"]),
        (
            '{ name = "count", type = "u8" }',
            '{ name = "age_us", type = "u8" }',
            ["command: 'age_us' cannot be in it"],
        ),
        ('{ name = "count", type = "u8" }', '{ name = "sequence" }', ["command", "'sequence'", "twice"]),
        (
            '{ name = "count", type = "u8" }',
            '{ name = "count", channels = 3 }',
            ["command: only pwm_us has"],
        ),
    ],
)
def test_an_invalid_file_is_reported_with_its_key(tmp_path: Path, old: str, new: str, messages: list[str]) -> None:
    text = LAYOUT[LAYOUT.index("byte_order =") :]
    assert old in text
    with pytest.raises(ConfigError) as caught:
        protocol(tmp_path, text.replace(old, new, 1))
    message = str(caught.value)
    assert message.startswith(str(tmp_path / "lab.toml"))
    assert all(word in message for word in messages), message


def test_a_length_field_too_small_for_the_longest_message_is_refused(tmp_path: Path) -> None:
    padding = ', { name = "pad", type = "u32" }' * 48  # 4 * 16 + 4 * 48 bytes, and the 5 of the header and the checksum
    text = COUNTED.replace('"length", type = "u16"', '"length"').replace('"u32" }]', f'"u32" }}{padding}]', 1)
    with pytest.raises(ConfigError, match="length must hold 261, which u8 cannot"):
        protocol(tmp_path, text)
    padding = '{ name = "length", type = "i8", adds = 64 }' + ', { name = "pad", type = "u32" }' * 16
    with pytest.raises(ConfigError, match="fields: length must hold 128, which i8 cannot"):
        protocol(tmp_path, FIXED.replace('{ name = "pad" }', padding, 1))


def test_messages_with_different_channel_counts_are_refused(tmp_path: Path) -> None:
    text = FIXED.replace('type = "u16", channels = 2', 'type = "u16", channels = 3')
    with pytest.raises(ConfigError, match="never have the same number of channels"):
        protocol(tmp_path, text)
