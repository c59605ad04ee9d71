"""The firmware's core in C behaves as its specification in Python, byte for byte, and stays within memory bounds."""

import json
import random
import struct
import subprocess
from pathlib import Path
from typing import Any

import pytest

from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from tests.support.firmware.c_core import Clock, Script, Step, first_difference, frame_script, run_c, run_python
from tests.support.links.link_contract import uuv_hil

GOLDEN: dict[str, Any] = json.loads((Path(__file__).parents[2] / "vectors" / "uuv_hil_frames.json").read_text())


@pytest.mark.parametrize("seed", range(4))
def test_the_core_matches_the_specification_on_a_bad_line(core: str, seed: int) -> None:
    script = frame_script(seed, 200, noisy=True)
    c, python = run_c(core, script), run_python(script, uuv_hil(), Clock())
    assert first_difference(script, c, python) is None
    last = [report for done in python for report in uuv_hil().feed(done.sent)][-1]
    assert isinstance(last, ThrusterTelemetry)
    assert min(last.frames, last.errors, last.watchdog_trips) > 2


@pytest.mark.parametrize("seed", range(100, 102))
def test_the_core_matches_the_specification_for_pieces_of_any_size(core: str, seed: int) -> None:
    script = frame_script(seed, 400, noisy=False)
    c, python = run_c(core, script), run_python(script, uuv_hil(), Clock(), chunk_size=4096)
    assert first_difference(script, c, python) is None


@pytest.mark.parametrize("vector", GOLDEN["sound"], ids=lambda vector: vector["name"])
def test_golden_frames_are_decoded(core: str, vector: dict[str, Any]) -> None:
    data, fields = bytes.fromhex(vector["hex"]), vector["fields"]
    channels = len(fields["pwm_us"])
    if vector["message"] == "telemetry":
        numbers = [fields[name] for name in ("age_us", "frames", "errors", "watchdog_trips")]
        flags = fields["sequence"], fields["armed"], fields["timed_out"], channels
        padded = (*fields["pwm_us"], *[0] * (16 - channels))
        report = struct.pack("<H??BIHHH16H", *flags, *numbers, *padded)
        assert subprocess.run([core, "encode"], input=report, capture_output=True).stdout == data
        return
    script = Script(channels, 200_000, [Step(0, data)])
    (done,) = run_c(core, script)
    answer = uuv_hil().feed(done.sent)[0]
    assert (answer.sequence, answer.armed) == (fields["sequence"], fields["armed"])
    assert done.pwm_us == tuple(p if 800 <= p <= 2200 else 0 for p in fields["pwm_us"]) or not fields["armed"]


@pytest.mark.parametrize("vector", GOLDEN["refused"], ids=lambda vector: vector["name"])
def test_refused_frames_are_counted_once(core: str, vector: dict[str, Any]) -> None:
    """Refused bytes are never executed; the command behind them is."""
    data, command = bytes.fromhex(vector["hex"]), ThrusterCommand(7, True, (1600,))
    script = Script(1, 200_000, [Step(0, data + uuv_hil().encode(command))])
    (done,) = run_c(core, script)
    (answer,) = [t for t in uuv_hil().feed(done.sent) if isinstance(t, ThrusterTelemetry) and t.sequence == 7][:1]
    assert (answer.frames, answer.errors, answer.pwm_us) == (1, 1, (1600,))


def test_a_million_bytes_of_noise_move_nothing(core: str) -> None:
    """The bytes are half random, half made of beginnings; nothing moves, and the reports, five a second, are sound."""
    rng = random.Random(3)
    hints = [b"\xa5\x5a", b"\xa5", b"\xa5\x5a\xff\x07", b"\xa5\x5a\x10\x01", b"\xfd", b"\xfd\xff\0\0", b"\xfd\x21\0\0"]
    steps = []
    for now_us in range(0, 20_000_000, 20_000):
        hinted = b"".join(rng.choice(hints) + rng.randbytes(rng.randrange(30)) for _ in range(32))
        steps.append(Step(now_us, rng.randbytes(500) + hinted))
    assert sum(len(step.data) for step in steps) > 1_000_000
    results = run_c(core, Script(6, 200_000, steps))
    assert {done.pwm_us for done in results} == {(1500,) * 6}
    host = uuv_hil()
    received = host.feed(b"".join(done.sent for done in results))
    assert len(received) == len(steps) // 10
    assert (host.counters.checksum_errors, host.counters.malformed, host.counters.dropped_bytes) == (0, 0, 0)
    assert received[-1].frames == 0  # type: ignore[union-attr]


def test_the_outputs_are_neutral_after_the_stop(core: str) -> None:
    command = uuv_hil().encode(ThrusterCommand(1, True, (1600, 0)))
    moving, stopped = run_c(core, Script(2, 200_000, [Step(0, command)]), stop=True)
    assert (moving.pwm_us, stopped.pwm_us) == ((1600, 0), (1500, 1500))
