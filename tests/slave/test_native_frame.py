"""The thruster frame in C gives the bytes and messages of Python's, whatever comes; and which of the two is taken."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.config import load_scenario
from hil.errors import ConfigError
from hil.links.contract import Counters, Message, ThrusterCommand, ThrusterTelemetry
from hil.links.frame.protocol import FrameProtocol, open_frame
from hil.schema import preset_names
from hil.slave.native import make_frame_protocol
from hil.slave.native.frame import NativeFrameProtocol, is_ours
from hil.slave.stm32 import end_protocol
from tests.twins import EACH as EACH_TWIN
from tests.twins import taken_from

FRAMES = Path(__file__).parents[2] / "firmware_stub" / "frames"
EACH = settings(EACH_TWIN, max_examples=300)
NUMBERS = st.integers(0, 0xFFFF)
PULSES = st.lists(NUMBERS, min_size=1, max_size=16).map(tuple)
COMMANDS = st.builds(ThrusterCommand, NUMBERS, st.booleans(), PULSES)
REPORTS = st.builds(
    ThrusterTelemetry, NUMBERS, st.booleans(), st.booleans(), PULSES,
    st.integers(0, 0xFFFF_FFFF), NUMBERS, NUMBERS, NUMBERS,
)  # fmt: skip
MESSAGES = st.one_of(COMMANDS, REPORTS)


@pytest.fixture(autouse=True)
def native(binaries: Path) -> Iterator[None]:
    with taken_from(binaries):
        yield


def counts(counters: Counters) -> list[int]:
    return [getattr(counters, name) for name in Counters.__slots__]


@EACH
@given(MESSAGES)
def test_the_same_bytes_and_back(message: Message) -> None:
    plain = open_frame("host", 6)
    quick = NativeFrameProtocol(open_frame("host", 6))
    frame = plain.encode(message)
    assert quick.encode(message) == frame
    (heard,) = quick.feed(frame)
    assert heard == message
    assert type(heard) is type(message)
    assert [type(value) for value in heard] == [type(value) for value in message]


@EACH
@given(st.integers(-70_000, 70_000), st.lists(st.integers(-70_000, 70_000), min_size=1, max_size=16), st.booleans())
def test_what_does_not_fit_is_packed_as_in_python(sequence: int, pulses: list[int], armed: bool) -> None:
    command = ThrusterCommand(sequence, armed, tuple(pulses))
    report = ThrusterTelemetry(1, armed, False, tuple(pulses), sequence, sequence, 0, 0)
    for message in (command, report):
        assert NativeFrameProtocol(open_frame("host", 6)).encode(message) == open_frame("host", 6).encode(message)


def test_too_many_thrusters_are_refused_as_in_python() -> None:
    for pulses in ((), (1500,) * 17):
        with pytest.raises(ValueError, match="carries"):
            NativeFrameProtocol(open_frame("host", 6)).encode(ThrusterCommand(1, True, pulses))


@st.composite
def lines(draw: st.DrawFn) -> list[bytes]:
    """What a line may give: frames, some of them damaged or cut, noise between, in pieces as they come."""
    protocol = open_frame("host", 6)
    stream = b""
    for _ in range(draw(st.integers(0, 6))):
        frame = protocol.encode(draw(MESSAGES))
        kind = draw(st.sampled_from(["whole", "whole", "damaged", "cut", "noise"]))
        if kind == "damaged":
            place = draw(st.integers(0, len(frame) - 1))
            frame = frame[:place] + bytes([frame[place] ^ draw(st.integers(1, 255))]) + frame[place + 1 :]
        elif kind == "cut":
            frame = frame[: draw(st.integers(0, len(frame)))]
        stream += draw(st.binary(max_size=30)) if kind == "noise" else frame
    cuts = sorted(draw(st.lists(st.integers(0, len(stream)), max_size=5)))
    return [stream[start:end] for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True)]


@EACH
@given(lines())
def test_the_same_messages_and_counts_of_any_line(pieces: list[bytes]) -> None:
    plain, below = open_frame("host", 6), open_frame("host", 6)
    quick = NativeFrameProtocol(below)
    for piece in pieces:
        assert quick.feed(piece) == plain.feed(piece)
        assert counts(quick.counters) == counts(plain.counters)
        assert below.reader.unfinished == plain.reader.unfinished


@pytest.mark.parametrize("name", preset_names("firmware_stub/frames"))
@pytest.mark.parametrize("channels", [1, 6, 8])
def test_only_its_own_frame_is_taken_over(name: str, channels: int) -> None:
    try:
        protocol = open_frame("device", channels, name)
    except ConfigError:  # one that carries other numbers of thrusters
        assert name != "uuv_hil"
        return
    made = make_frame_protocol(protocol, channels)
    assert (type(made) is NativeFrameProtocol) == (name == "uuv_hil")


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('byte_order = "little"', 'byte_order = "big"'),
        ("sync = [0xA5, 0x5A]", "sync = [0xA5, 0x5B]"),
        ("crc16-ccitt-false", "crc16-xmodem"),
        ('{ name = "pwm_us", type = "u16" }', '{ name = "pwm_us", type = "i16" }'),
        ('{ name = "pwm_us", type = "u16" }', '{ name = "pwm_us", type = "u16", scale = 0.5 }'),
        ("bits = { armed = 0, timed_out = 1 }", "bits = { armed = 1, timed_out = 0 }"),
        ('{ name = "frames", type = "u16" }', '{ name = "errors", type = "u16" }'),
        ('{ name = "sequence", type = "u16" }', '{ name = "sequence", type = "u8" }'),
        (
            "[telemetry]",
            '[[other]]\nname = "alive"\nid = 9\nsent_by = "both"\nperiod = "1 s"\nfields = []\n\n[telemetry]',
        ),
    ],
)
def test_a_frame_file_that_was_changed_is_not(before: str, after: str, tmp_path: Path) -> None:
    text = (FRAMES / "uuv_hil.toml").read_text()
    assert before in text
    changed = text.replace(before, after)
    if "errors" in after:  # they change places
        changed = text.replace('"frames"', '"x"').replace('"errors"', '"frames"').replace('"x"', '"errors"')
    path = tmp_path / "mine.toml"
    path.write_text(text)
    assert is_ours(FrameProtocol(str(path), "host", 6), 6), "unchanged it is, wherever it lies"
    path.write_text(changed)
    protocol = FrameProtocol(str(path), "host", 6)
    assert not is_ours(protocol, 6)
    assert make_frame_protocol(protocol, 6) is protocol


def test_the_quickest_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    link = load_scenario("paper_field").link
    assert type(end_protocol(link, "host", 6)) is NativeFrameProtocol
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "hil.slave.native._frame", None)  # as if made before there was one
        assert type(end_protocol(link, "host", 6)) is FrameProtocol
    monkeypatch.setenv("UUV_HIL_NATIVE", "0")
    assert type(end_protocol(link, "host", 6)) is FrameProtocol


def test_what_is_no_message_or_no_bytes() -> None:
    module = sys.modules["hil.slave.native._frame"]
    assert module.pack((1, True, (1500,))) is None
    assert module.pack(ThrusterCommand(1, True, ("fast",))) is None  # type: ignore[arg-type]
    assert module.read(b"") is None
    with pytest.raises(TypeError):
        module.read("text")
