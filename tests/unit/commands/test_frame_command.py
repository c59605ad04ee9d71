"""`uuv-hil link frame`: byte tables, transmission times, and bytes decoded field by field."""

import io

import pytest

from hil.commands import frame
from hil.common.schema import find_preset, preset_names
from hil.links.contract import ThrusterCommand
from hil.links.frame.check import split_bytes
from hil.links.frame.protocol import FrameProtocol

NAMES = preset_names("firmware_stub/frames")
VALID = "AA 55 05 10 07 01 f4 01 12"


def open_frame_protocol(name: str) -> FrameProtocol:
    return FrameProtocol(find_preset("firmware_stub/frames", name))


def run_frame(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    code = frame.main(list(arguments))
    return code, capsys.readouterr().out


def test_tables_show_bytes(capsys: pytest.CaptureFixture[str]) -> None:
    code, text = run_frame(capsys, "check", "aa55", "--thrusters", "2")
    assert code == 0
    assert "sum8 from byte 2 up to itself" in text
    for message in (
        "command, 11 bytes", "6 i16[2] pwm_us 0.001 normalised, 1900 us is 1 normalised", "3 u8 id 0x10",
        "telemetry, 20 bytes", "5 u8 flags bit 0 armed, bit 7 timed_out", "8 u16 supply_voltage 0.001 V, ignored",
        "15 i16 pwm_us[1] rpm, 1900 us is 3000 rpm", "keep-alive, from the host after 100 ms of silence, 5 bytes",
    ):  # fmt: skip
        assert message in " ".join(text.split()), message


@pytest.mark.parametrize("name", NAMES)
def test_every_byte_table_is_as_long_as_its_frame(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    protocol = open_frame_protocol(name)
    stuffing = 2 if name == "cobs_thrust" else 0  # the code byte and the delimiter
    for thrusters in (1, 7, 16):
        size = len(protocol.encode(ThrusterCommand(1, True, (1600,) * thrusters))) - stuffing
        assert f"command, {size} bytes" in run_frame(capsys, "check", name, "--thrusters", str(thrusters))[1]


def test_a_valid_message_is_decoded(capsys: pytest.CaptureFixture[str]) -> None:
    for words in ([VALID], VALID.split(), ["0xAA,0x55 0x5", "0x1007", "01:f4:01", r"\x12"]):
        code, text = run_frame(capsys, "check", "aa55", *words)
        assert code == 0
        assert " ".join(text.split()).startswith("0 command sequence 7 armed True pwm_us 1700")
        assert text.endswith("9 bytes, 1 messages, 0 bytes wrong\n")


def test_bytes_are_read_from_standard_input(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("aa5505100701\nf40112\n"))
    assert run_frame(capsys, "check", "aa55", "-")[0] == 0


def test_a_single_wrong_byte_is_located(capsys: pytest.CaptureFixture[str]) -> None:
    data = bytearray(open_frame_protocol("uuv_hil").encode(ThrusterCommand(9, True, (1500, 1600))))
    data[6] = 0x03
    code, text = run_frame(capsys, "check", "uuv_hil", data.hex())
    assert code == 1
    assert "damaged: command: checksum 0x" in text
    assert "right if byte 6 (flags) were 0x01, not 0x03" in text


def test_noise_cut_frames_and_unknown_messages_are_distinguished(capsys: pytest.CaptureFixture[str]) -> None:
    protocol = open_frame_protocol("uuv_hil")
    valid = protocol.encode(ThrusterCommand(9, True, (1500,)))
    unknown = bytes.fromhex("a5 5a 03 7f 01 02 03 74 08")
    code, text = run_frame(
        capsys, "check", "uuv_hil", (b"\x00\x01" + valid + valid[:5] + unknown + valid + valid[:3]).hex()
    )
    assert code == 1
    kinds = [line.strip() for line in text.splitlines() if line[:6].strip()]
    assert kinds == [
        "0  dropped: no frame",
        "2  command",
        "14  dropped: a frame cut short, or of a message that is not known",
        "19  malformed: sound, but its message is not known",
        "28  command",
        "40  unfinished: the beginning of a frame whose end is not there",
        "43 bytes, 2 messages, 19 bytes wrong",
    ]


@pytest.mark.parametrize("name", NAMES)
def test_every_byte_belongs_to_exactly_one_part(name: str) -> None:
    good = open_frame_protocol(name).encode(ThrusterCommand(9, True, (1500, 1600)))
    damaged = bytes([*good[:-3], good[-3] ^ 0x10, *good[-2:]])
    data = b"\xff\xaa" + good + damaged + good[:4] + good + b"\x00\x00" + good + good[:5]
    pieces = split_bytes(open_frame_protocol(name), data)
    assert b"".join(piece.data for piece in pieces) == data
    assert [piece.start for piece in pieces] == [sum(len(p.data) for p in pieces[:i]) for i in range(len(pieces))]
    received = [piece.message for piece in pieces if piece.message]
    assert received == open_frame_protocol(name).feed(data)
    assert len(received) == 3
    assert "damaged" in {piece.kind for piece in pieces}
