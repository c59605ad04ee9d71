"""`uuv-hil bench delay` with short runs: its figures, failures, records and pictures, and wrong options."""

import itertools
import json
import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hil.bench import delay_run
from hil.bench.delay_run import HOPS, Plan, Result, first_motion, measure, pooled
from hil.bench.harness import Bench, Process, program
from hil.cli import main
from hil.client.client import VehicleClient
from hil.client.delay import DelayMeter
from hil.commands.bench import delay as bench_delay
from hil.common.clock import NS_PER_S, from_wall_ns, now_ns
from hil.common.errors import NetworkError
from tests.support.delay_results import MS, meter, some_result
from tests.support.processes import wait_for


def test_motion_begins_where_the_velocity_leaves_its_trend() -> None:
    decay = [(number * 10 * MS, 0.5 - 0.02 * number) for number in range(10)]
    moved = [*decay[:7], (71 * MS, 0.5 - 0.02 * 7 + 0.3), (81 * MS, 0.9)]
    assert first_motion(moved, 65 * MS, 1.0) == 71 * MS
    assert first_motion(moved, 65 * MS, -1.0) == 0
    assert first_motion(decay, 65 * MS, 1.0) == 0
    assert first_motion(moved[:1], 65 * MS, 1.0) == 0


def test_quick_runs_have_consistent_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, picture = tmp_path / "delay.json", tmp_path / "delay.png"
    options = ["--seconds", "0.5", "--rate", "40", "--steps", "3", "--baud", "0,115200", "--output", str(path)]
    code = main(["bench", "delay", *options, "--plot", str(picture)])
    output = capsys.readouterr().out
    assert code == 0, output
    assert "clock" not in output  # wrong ones would be warned of
    assert "its baud is not" not in output
    figures = json.loads(path.read_text())["figures"]
    for case in ("baud 0", "baud 115200"):
        delays = figures[f"delay [{case}]"]["values"]
        assert 10 <= len(delays) <= 20, "a busy machine answers some commands together"
        hops = [figures[f"hop {name} [{case}]"]["values"] for name in HOPS]
        assert [sum(parts) for parts in zip(*hops, strict=True)] == pytest.approx(delays, abs=1e-6)
        assert all(value >= 0.0 for values in hops for value in values)
        assert figures[f"motion [{case}]"]["values"]
        assert min(figures[f"motion [{case}]"]["values"]) > min(delays)
        assert figures[f"tcp floor [{case}]"]["count"] >= 5
        assert figures[f"tcp floor [{case}]"]["better"] == figures[f"udp floor [{case}]"]["better"] == ""
        assert figures[f"delay [{case}]"]["better"] == "lower"
    assert figures["hop wire [baud 0]"]["median"] == 0.0
    assert figures["hop wire [baud 115200]"]["median"] == pytest.approx(22 * 10 / 115.2)
    assert min(figures["delay [baud 115200]"]["values"]) > 22 * 10 / 115.2
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_runs_are_pooled_and_distinguished() -> None:
    runs = [some_result([0.7] * 4), some_result([0.9] * 3, sent=4, rate=18.0, warnings=["late"])]
    both = pooled(runs)
    assert both.values["delay"] == [0.7] * 4 + [0.9] * 3
    assert (both.sent, both.warnings, len(both.values["hop wire"])) == (8, ["run 2: late"], 7)
    assert pooled(runs[:1]) == runs[0]


class CommandedVehicle:
    """A vehicle that records the times of its commands (ns), by `clock`."""

    def __init__(self, clock: Callable[[], int] = now_ns) -> None:
        self.times_ns: list[int] = []
        self.surge: list[tuple[int, float]] = []
        self.delays = DelayMeter()
        self._clock = clock

    def command(self, _: Any) -> None:
        self.times_ns.append(self._clock())


def test_the_last_command_gets_its_full_period(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first step of the motion would otherwise replace it in the slave's command_receiver."""
    monkeypatch.setattr(delay_run, "check_present", lambda *_: None)
    vehicle: Any = CommandedVehicle()
    delay_run._command(vehicle, None, Plan(rate=200.0, seconds=0.1), None)
    assert now_ns() - vehicle.times_ns[-1] > 0.9 * NS_PER_S / 200.0


def test_motion_before_the_pulses_is_not_counted() -> None:
    """The earlier motion continues until then. A command without a trace counts from the time it was sent."""
    received = meter(0, same_clock=True)
    sent = from_wall_ns(received.samples(1)[-1].published_ns)
    applied = delay_run._applied_ns(received, sent - 1000)
    assert applied - sent == received.totals_ns()[-1] == 660_000
    assert delay_run._applied_ns(received, sent + 1) == sent + 1
    assert delay_run._applied_ns(DelayMeter(), sent) == sent
    bent = [
        (sent + times_ns, value)
        for times_ns, value in ((-20 * MS, 0.0), (-10 * MS, 0.0), (300_000, 0.06), (10 * MS, 0.3))
    ]
    assert first_motion(bent, sent, 1.0) == sent + 300_000
    assert first_motion(bent, applied, 1.0) == sent + 10 * MS


@pytest.mark.parametrize("late_us", [0, 300, 480])
def test_steps_begin_at_all_phases_between_two_samples(monkeypatch: pytest.MonkeyPatch, late_us: int) -> None:
    """The motion would otherwise wait for its sample equally long in all of a run, however late each step is."""
    clock = [0]

    def wait_ns(deadline: int) -> None:
        clock[0] = deadline + late_us * 1000

    monkeypatch.setattr(delay_run, "check_present", lambda *_: None)
    monkeypatch.setattr(delay_run, "now_ns", lambda: clock[0])
    monkeypatch.setattr(delay_run, "wait_ns", wait_ns)
    vehicle: Any = CommandedVehicle(lambda: clock[0])
    delay_run._motion(vehicle, None, 11)
    phases = sorted(times_ns % (10 * MS) / MS for times_ns in vehicle.times_ns)
    assert len(phases) == 11
    assert max(after - before for before, after in itertools.pairwise([*phases, phases[0] + 10.0])) < 2.0


def test_a_killed_slave_gives_an_error_and_no_result() -> None:
    with Bench("paper_field") as bench:

        def kill() -> None:
            assert wait_for(lambda: bench.processes and "ready" in bench.processes[0].output)
            with VehicleClient(bench.endpoint, "uuv1", role="observer") as onlooker:
                assert wait_for(lambda: (onlooker.diagnostics().commands_taken or 0) > 20)
                os.kill(bench.processes[0].pid, signal.SIGKILL)

        thread = threading.Thread(target=kill)
        thread.start()
        with pytest.raises(NetworkError, match=r"the slave was ended by signal 9"):
            measure(bench, Plan(seconds=120.0))
        thread.join()


def test_a_killed_slave_on_another_machine_gives_an_error(tmp_path: Path) -> None:
    """The floor is missing without an echo."""
    with Bench("paper_field") as bench:
        slave = bench.start_slave()
        command = [*program(), "bench", "delay", "--connect", bench.endpoint, "--steps", "2", "--seconds"]
        with Process([*command, "1"], str(tmp_path / "whole")) as whole:
            assert whole.wait(120.0) == 0, whole.output
            assert "no floor" in whole.output
        with VehicleClient(bench.endpoint, "uuv1", role="observer") as onlooker:
            before = wait_for(onlooker.diagnostics)
            assert before
            with Process([*command, "120"], str(tmp_path / "log")) as delay:
                taken = before.commands_taken or 0
                assert wait_for(lambda: (onlooker.diagnostics().commands_taken or 0) > taken + 20), delay.output
                os.kill(slave.pid, signal.SIGKILL)
                assert delay.wait(60.0) == 4, delay.output
            assert f"uuv1 at {bench.endpoint} has " in delay.output  # been silent, in one way or another


def failing_second(results: list[Result]) -> Any:
    def run(*_: Any) -> tuple[Result, tuple[str, ...]]:
        if not results:
            raise NetworkError("the slave ended")
        return results.pop(0), ("limited: for the test",)

    return run


def test_results_are_saved_when_a_later_run_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench_delay, "_measure", failing_second([some_result([0.7] * 20, {"motion": []})]))
    path = tmp_path / "record.json"
    assert main(["bench", "delay", "--load", "0,1,2", "--output", str(path)]) == 4
    output = capsys.readouterr()
    assert "load 0" in output.out
    assert "label: limited: for the test" in output.out
    assert "the slave ended" in output.err
    figures = json.loads(path.read_text())["figures"]
    assert figures["delay [load 0]"]["count"] == 20
    assert "motion [load 0]" not in figures


def test_repeated_runs_are_in_the_record_one_by_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The configurations take turns, so that a machine that slows down does so for all of them."""
    results = [some_result([value] * count) for value, count in ((0.1, 4), (0.2, 3), (0.3, 2), (0.4, 1))]
    monkeypatch.setattr(bench_delay, "_measure", failing_second(results))
    path = tmp_path / "a.json"
    assert main(["bench", "delay", "--load", "0,1", "--repeat", "2", "--output", str(path)]) == 0
    figure = json.loads(path.read_text())["figures"]["delay [load 0]"]
    assert figure["values"] == [0.1] * 4 + [0.3] * 2
    assert "6/6" in capsys.readouterr().out


def test_the_record_has_the_clocks_of_each_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = some_result([0.7] * 20, clock_offset=-3.5, clock_uncertainty=0.125, sent=21)
    monkeypatch.setattr(bench_delay, "_measure", failing_second([result]))
    new = tmp_path / "new.json"
    assert main(["bench", "delay", "--output", str(new)]) == 0
    record = json.loads(new.read_text())
    (run,) = record["details"]["as the scenario has it"]["runs"]
    assert (run["clock offset"], run["clock uncertainty"]) == (-3.5, 0.125)
