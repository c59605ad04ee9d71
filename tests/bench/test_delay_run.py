"""`uuv-hil bench delay`, quickly: its figures add up, it notices wrong clocks, and it refuses nonsense."""

import json
from pathlib import Path
from typing import Literal

import pytest

from hil.bench.delay_report import text
from hil.bench.delay_run import HOPS, Result, first_motion, judge, wire_ms
from hil.cli import main
from hil.config import load_scenario
from hil.links.wires.faults import Faults
from hil.master.delay import DelayMeter

MS = 1_000_000


def meter(offset: int, same_clock: bool, network: int = MS // 2, count: int = 60, back: int = MS // 2) -> DelayMeter:
    """Commands to a slave whose clock is `offset` ns ahead."""
    found = DelayMeter()
    found.same_clock = same_clock
    for number in range(count):
        published = number * 50 * MS
        received = published + network + offset
        taken, computed, written, applied = (received + us * 1000 for us in (20, 100, 150, 160))
        sent = applied + 20_000
        instants = [number, published, received, taken, written, applied, computed]
        found.add(instants, sent, sent - offset + back)
    return found


def test_right_clocks_are_trusted() -> None:
    assert judge(meter(0, same_clock=True)) == []
    assert judge(meter(7_000 * MS, same_clock=False, network=MS // 10, back=MS // 10)) == []


def test_a_shifted_clock_never_gives_a_negative_delay_unnoticed() -> None:
    shifted = meter(-5 * MS, same_clock=True)
    assert min(shifted.totals_ns()) < 0
    found = judge(shifted)
    assert any("60 of 60 commands arrived before they were sent" in words for words in found)
    assert any("-5.0" in words and "should be the master's" in words for words in found)


def test_a_shift_that_only_flatters_or_slows_is_noticed_too() -> None:
    """The delay stays positive, but the exchanges contradict it."""
    assert any("5.0" in words for words in judge(meter(5 * MS, same_clock=True)))
    assert judge(meter(-MS // 2 - 60_000, same_clock=True)) != []


def test_an_offset_that_is_not_known_well_enough_is_said() -> None:
    found = judge(meter(3 * MS, same_clock=False, network=MS, back=30 * MS))
    assert any("known only to" in words for words in found)


def test_a_clock_that_is_set_meanwhile_is_noticed() -> None:
    found = meter(0, same_clock=False)
    late = meter(900 * MS, same_clock=False, count=70)
    for sample in late.samples[60:]:
        published, received = sample.published_ns, sample.published_ns + sample.hops[0]
        sent = received + 180_000
        instants = [1, published, received, received + 20_000, received + 150_000, received + 160_000]
        found.add(instants, sent, sent - 900 * MS + MS // 2)
    assert any("a clock was set" in words for words in judge(found))


def test_no_answer_is_no_result() -> None:
    assert judge(DelayMeter()) == ["no command was answered by the STM32"]


def test_text_leaves_out_what_too_few_commands_cannot_tell() -> None:
    hops = {name: [0.1] * 200 for name in HOPS}
    result = Result([0.7] * 200, [0.0] * 200, hops, [4.0], [0.06] * 9, [0.05] * 9, 0.0, 200, 0.0, 0.0, ["a clock"])
    lines = text({"case": result}).splitlines()
    assert lines[2].split() == [
        "case", "200/200", "0.700", "0.700", "0.700", "-", "0.700", "0.050", "0.650", "0.060", "0.050", "4.0",
    ]  # fmt: skip
    assert "0.100 (14%)" in text({"case": result})
    assert lines[-1] == "WARNING, case: a clock"


def test_motion_is_what_leaves_the_line() -> None:
    decay = [(number * 10 * MS, 0.5 - 0.02 * number) for number in range(10)]
    moved = [*decay[:7], (71 * MS, 0.5 - 0.02 * 7 + 0.3), (81 * MS, 0.9)]
    assert first_motion(moved, 65 * MS, 1.0) == 71 * MS
    assert first_motion(moved, 65 * MS, -1.0) == 0
    assert first_motion(decay, 65 * MS, 1.0) == 0
    assert first_motion(moved[:1], 65 * MS, 1.0) == 0


def test_quick_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, picture = tmp_path / "delay.json", tmp_path / "delay.png"
    options = ["--seconds", "0.5", "--rate", "40", "--steps", "3", "--baud", "0,115200", "--json", str(path)]
    code = main(["bench", "delay", *options, "--most-p50", "500", "--most-over-floor", "0.0001", "--png", str(picture)])
    said = capsys.readouterr().out
    assert code == 1, said
    assert said.count("LIMIT BROKEN") == 2
    assert "p50 above the floor" in said
    assert "WARNING" not in said
    figures = json.loads(path.read_text())["figures"]
    for case in ("baud 0", "baud 115200"):
        delays = figures[f"delay [{case}]"]["values"]
        assert len(delays) == 20
        hops = [figures[f"hop {name} [{case}]"]["values"] for name in HOPS]
        assert [sum(parts) for parts in zip(*hops, strict=True)] == pytest.approx(delays, abs=1e-6)
        assert all(value >= 0.0 for values in hops for value in values)
        assert figures[f"motion [{case}]"]["values"]
        assert min(figures[f"motion [{case}]"]["values"]) > min(delays)
        assert figures[f"tcp floor [{case}]"]["count"] >= 5
    assert figures["hop wire [baud 0]"]["median"] == 0.0
    assert figures["hop wire [baud 115200]"]["median"] == pytest.approx(22 * 10 / 115.2, rel=0.05)
    assert min(figures["delay [baud 115200]"]["values"]) > 22 * 10 / 115.2
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--baud", "fast"], "--baud 'fast'"),
        (["--baud", "-1"], "--baud"),
        (["--rate", "0"], "--rate '0'"),
        (["--security", "maybe"], "--security 'maybe'"),
        (["--seconds", "0"], "--seconds"),
        (["--protocol", "morse"], "protocol"),
        (["--stm32", "abacus"], "stm32"),
        (["--slave", "tcp/127.0.0.1:1", "--stm32", "native"], "--slave is measured as it is"),
        (["--echo", "here"], "--echo 'here'"),
    ],
)
def test_what_cannot_be_meant(options: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [f"{options[0]}={options[1]}", *options[2:]]
    assert main(["bench", "delay", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_the_time_on_the_line() -> None:
    """115200 bit/s, ten bits a byte; the answer counts where it has to be heard."""
    scenario = load_scenario("paper_field")
    paced = scenario._replace(link=scenario.link._replace(faults=Faults(baud=115_200)))
    assert wire_ms(scenario, {"link_port": "/dev/pts/0"}) == 0.0
    command = wire_ms(paced, {})
    assert command == pytest.approx(22 * 10 / 115.2)
    assert wire_ms(scenario, {"link_port": "/dev/ttyUSB0"}) == command
    assert wire_ms(paced._replace(stm32="native"), {}) > 2 * command
    assert wire_ms(paced._replace(stm32="unicorn"), {}) == command


def test_on_its_line_mavlink_is_the_packet_of_pulses_alone() -> None:
    """The host asks for arming beside it until the device has said that it is: SERVO_OUTPUT_RAW has 28 bytes here."""
    scenario = load_scenario("paper_field")
    link = scenario.link._replace(protocol="mavlink", faults=Faults(baud=115_200))
    assert wire_ms(scenario._replace(link=link), {}) == pytest.approx(28 * 10 / 115.2)
    assert wire_ms(scenario._replace(link=link, stm32="native"), {}) == pytest.approx(2 * 28 * 10 / 115.2)


@pytest.mark.parametrize(("protocol", "bits"), [("vesc", 6 * (67 + 32)), ("dronecan", 2 * 67 + 64 + 56)])
def test_a_command_on_a_can_bus_takes_the_bits_of_all_its_frames(
    protocol: Literal["vesc", "dronecan"], bits: int
) -> None:
    """VESC: a frame of 4 bytes a thruster. DroneCAN: 6 x 14 bits and the checksum, with two tails in two frames."""
    scenario = load_scenario("paper_field")
    link = scenario.link._replace(protocol=protocol, port="can:virtual:bits", faults=Faults(baud=500_000))
    paced = scenario._replace(link=link)
    assert wire_ms(paced, {}) == pytest.approx(bits / 500)
    assert wire_ms(paced._replace(stm32="process"), {}) > 2 * wire_ms(paced, {})
