"""`uuv-hil link loopback`: both ends in this process, an external STM32, or a wire from TX to RX."""

import json
import threading
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest

from hil.bench.loopback import Plan, _Test, wire_ms
from hil.cli import main
from hil.common.clock import NS_PER_S
from hil.links.wires.faults import Faults
from hil.links.wires.terminal import PtyWire
from hil.scenario.records import Link
from hil.slave.drivers.driver import open_driver
from tests.support.links.link_contract import nothing_leaks, wait_readable
from tests.support.processes import Program


def loopback(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    code = main(["link", "loopback", "--json", "--seconds", "0.4", *arguments])
    return code, json.loads(capsys.readouterr().out)


@pytest.fixture
def long_reply_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait for answers so long that none is lost, however late the machine lets it come."""
    monkeypatch.setattr("hil.bench.loopback.LOST_NS", 60 * NS_PER_S)


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("--rate", "100"),
        ("--rate", "0"),
        ("--rate", "100", "--fault", "baud=9600"),
        ("--protocol", "mavlink"),
        ("--protocol", "vesc", "--port", "can:virtual:loop"),
        ("--protocol", "dronecan", "--port", "can:virtual:loop"),
        ("--port", "tcp://127.0.0.1:0"),
        ("--stm32", "unicorn"),
    ],
    ids=" ".join,
)
@pytest.mark.usefixtures("long_reply_timeout")
def test_a_sound_link_loses_nothing(arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    with nothing_leaks():
        code, output = loopback(capsys, *arguments)
    # On a busy machine the kernel may still hold a command when the next one comes, which then takes its place; that
    # one does not count as sent.
    assert output["answered"] == output["sent"] >= 1, "20 where nothing else uses the machine"
    assert (output["lost"], output["errors"]) == (0, 0)
    assert output["seconds"] < 50.0, "it waits for no command that was never sent"
    assert (code, output["broken_limits"]) == (0, []), output
    assert 0.0 < output["p50_ms"] <= output["p99_ms"] <= output["max_ms"]
    assert output["counters"]["bytes_out"] > 0


def test_the_rest_of_the_period_does_not_count_as_round_trip_time(capsys: pytest.CaptureFixture[str]) -> None:
    code, found = loopback(capsys, "--rate", "5", "--seconds", "1")
    assert code == 0, found
    assert found["p50_ms"] < 190.0, "of 200"


def test_p99_of_a_hundred_round_trips_is_not_the_maximum() -> None:
    plan = Plan("python", Link(options={}), 6, 50.0, 1.0, False)
    test = _Test(plan, open_driver("python", plan.link, 6, True, 1, print))
    with closing(test._far):
        test._trips_ns = [number * 1_000_000 for number in range(100, 0, -1)]
        result = test.result()
    assert (result.p50_ms, result.p99_ms, result.max_ms) == (50.0, 99.0, 100.0)


def test_losses_and_delays_of_a_bad_line_are_reported_and_break_limits(capsys: pytest.CaptureFixture[str]) -> None:
    bad = ("--fault", "drop=0.2", "--fault", 'delay="20 ms"', "--max-p99", "10 ms")
    code, output = loopback(capsys, *bad, "--seconds", "1")
    assert code == 1
    assert 0.1 < output["loss"] < 0.7  # both ways
    assert output["p50_ms"] > 39.0
    assert [text.split()[0] for text in output["broken_limits"]] == ["loss", "p99"]
    code, output = loopback(capsys, "--fault", "drop=0.2", "--max-loss", "0.9", "--max-errors", "99")
    assert code == 0


@pytest.mark.usefixtures("long_reply_timeout")
def test_the_wire_time_follows_from_the_number_of_bits(capsys: pytest.CaptureFixture[str]) -> None:
    """The 22 + 32 bytes of ten bits take 4.69 ms at 115200 baud, and the paced link takes at least that."""
    plan = Plan("python", Link(faults=Faults(baud=115_200)), 6, 50.0, 1.0, True)
    assert wire_ms(plan) == pytest.approx(54 * 10 / 115.2, rel=1e-12)
    code, output = loopback(capsys, "--fault", "baud=115200", "--rate", "0")
    assert code == 0
    assert output["wire_ms"] == pytest.approx(4.6875)
    assert output["p50_ms"] > 4.2, "its timer may be 0.2 ms early, each way"
    assert loopback(capsys)[1]["wire_ms"] is None


@pytest.fixture
def jumper_port() -> Iterator[str]:
    """Provide a serial port whose TX is wired to its RX."""
    far_end, stop = PtyWire(), threading.Event()

    def echo() -> None:
        while not stop.is_set():
            if wait_readable(far_end, 0.02):
                far_end.write(far_end.read())

    thread = threading.Thread(target=echo)
    thread.start()
    yield far_end.path
    stop.set()
    thread.join()
    far_end.close()


@pytest.mark.parametrize("protocol", ["frame", "mavlink"])
@pytest.mark.usefixtures("long_reply_timeout")
def test_a_jumper_from_tx_to_rx_returns_every_frame(
    protocol: str, jumper_port: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, output = loopback(capsys, "--stm32", "jumper", "--port", jumper_port, "--protocol", protocol)
    assert code == 0, output
    assert output["answered"] == output["sent"] >= 1
    assert output["counters"]["bytes_in"] == output["counters"]["bytes_out"] > 0


def test_a_device_is_armed_only_on_request(tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "ttySTM32"
    with Program(tmp_path, "stm32", "--port", f"pty:{path}") as stm32:
        stm32.expect("Ctrl-C")
        code, found = loopback(capsys, "--stm32", "device", "--port", str(path))
        assert (code, found["lost"]) == (0, 0)
        stm32.stop(15)
    (last,) = [line for line in stm32.output.splitlines() if line.startswith("stopped:")]
    assert "pwm 1500 1500 1500 1500 1500 1500" in last
    assert int(last.split()[1]) >= 5  # commands it took, and all of them were disarmed
