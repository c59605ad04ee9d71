"""Campaigns: combinations of values, rows of failed runs, the table, the end of workers."""

import csv
import os
import signal
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from hil.cases.campaign import RunProgress, combinations, run_one
from hil.cli import main
from hil.commands import campaign
from tests.support.processes import Program, command_line, wait_for, write_scenario


def test_variations_make_all_combinations() -> None:
    assert combinations([]) == [{}]
    sets = combinations(["master.speed=0.5,0.6", "stm32=python"])
    assert sets == [{"master.speed": 0.5, "stm32": "python"}, {"master.speed": 0.6, "stm32": "python"}]


def test_too_many_combinations_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """Ten keys of ten values each are refused before one is made."""
    values = ",".join(map(str, range(10)))
    vary = [word for number in range(10) for word in ("--vary", f"key{number}={values}")]
    assert main(["campaign", "paper_field", *vary]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "10 of 'key0' x 10 of 'key1'" in line
    assert "make 10000000000 combinations, and a campaign has at most 10000: give fewer values" in line
    speeds = ",".join(str(0.3 + 0.01 * i) for i in range(20))
    assert main(["campaign", "paper_field", "--seeds", "100000", "--vary", f"master.speed={speeds}"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "20 combinations with 100000 seeds each are more than 1000000 runs" in line


def test_a_campaign_writes_a_row_for_each_run_and_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario, _ = write_scenario(tmp_path)
    output = tmp_path / "runs.csv"
    arguments = [str(scenario), "--seeds", "2", "--vary", "master.speed=0.4,0.8", "--jobs", "2", "-o", str(output)]
    assert campaign.main(arguments) == 0
    with output.open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["master.speed"], row["seed"]) for row in rows] == [
        ("0.4", "1"),
        ("0.4", "2"),
        ("0.8", "1"),
        ("0.8", "2"),
    ]
    assert all(row["reached"] == "True" for row in rows)
    slow, fast = (float(row["duration"]) for row in rows[1:3])
    assert slow > 1.5 * fast
    assert rows[0]["goal_error"] != rows[1]["goal_error"], "another seed is another run"
    table = capsys.readouterr().out
    assert "master.speed=0.4" in table
    assert "2/2" in table


def test_a_run_that_fails_is_a_row(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario, _ = write_scenario(tmp_path)
    assert campaign.main([str(scenario), "--seeds", "1", "--vary", "master.time_limit=3,40", "--jobs", "1"]) == 6
    output = capsys.readouterr().out
    assert "0/1" in output
    assert "1/1" in output
    assert "no success: time limit" in output


def test_the_progress_counts_what_is_flown_of_each_run(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    progress = RunProgress(str(tmp_path / "progress"), 2)
    shares: list[float] = []

    def note(share: float) -> None:
        shares.append(share)
        progress.write(1, share)

    assert run_one(str(scenario), {}, 1, note)["success"]
    assert len(shares) > 10
    assert shares == sorted(shares)
    assert 0.4 < progress.share() <= 0.5
    progress.write(0, 1.0)
    assert progress.share() > 0.9


def test_no_worker_outlives_the_campaign(tmp_path: Path) -> None:
    with Program(tmp_path, "campaign", write_scenario(tmp_path)[0], "--seeds", "10000", "--jobs", "2") as program:
        assert wait_for(lambda: "/10000" in program.output)
        assert len(workers(program)) == 2
        program.process.send_signal(signal.SIGTERM)
        assert program.wait() == 130, program.output
        assert wait_for(lambda: not workers(program))
    assert "Traceback" not in program.output


def test_ctrl_c_in_a_terminal_while_workers_load_leaves_one_line(tmp_path: Path) -> None:
    """It goes to the workers, too, which have only just been started."""
    scenario, _ = write_scenario(tmp_path)
    with Program(tmp_path, "campaign", scenario, "--seeds", "10000", "--jobs", "2") as program:
        assert wait_for(lambda: bool(workers(program)))
        os.killpg(program.process.pid, signal.SIGINT)
        assert program.wait() == 130
    assert program.output == "ended after 0 of 10000 runs; their results are discarded\n"


def workers(program: Program) -> list[str]:
    """Return the command lines of joblib's processes in the program's session, those that have ended left out."""
    command_lines = []
    for pid in psutil.pids():
        with suppress(ProcessLookupError):  # it has ended meanwhile
            if os.getsid(pid) == program.process.pid:
                command_lines.append(command_line(pid))
    return [line for line in command_lines if "LokyProcess" in line]
