"""Target hunting with a process for each slave and planner: a whole hunt, and lost processes."""

import os
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from hil.cases.hunt import processes
from hil.cases.hunt import watch as hunt_watch
from hil.cases.hunt.watch import HuntRow, HuntWatch
from hil.cases.process_group import ProcessGroup
from hil.cases.target_hunting import members_on_free_ports
from hil.common.errors import NetworkError
from hil.scenario.config import Scenario, load_scenario
from hil.scenario.variant import write_variant
from tests.support.processes import Program, command_line, wait_for

STARTS = ((6.2, 7.1), (3.0, 6.4), (3.0, 3.6), (6.2, 2.9))  # half round the target already, 2.4 m from it


@pytest.fixture
def scenario(tmp_path: Path) -> Scenario:
    members = members_on_free_ports("target_hunting")
    for member, (north, east) in zip(members, STARTS, strict=True):
        member.update(north=north, east=east)
    changes = {"member": members, "hunting.target": [5.0, 5.0]}
    return load_scenario(write_variant("target_hunting", str(tmp_path), changes))


@pytest.fixture
def groups(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[ProcessGroup]]:
    """Provide the slaves and the agents that a flight starts; afterwards none of them is left."""
    process_groups: list[ProcessGroup] = []

    class Noted(ProcessGroup):
        def __enter__(self) -> "Noted":
            process_groups.append(self)
            super().__enter__()
            return self

    monkeypatch.setattr(processes, "ProcessGroup", Noted)
    yield process_groups
    assert [len(crew.pids) for crew in process_groups] == [4, 4]
    assert not [pid for crew in process_groups for pid in crew.pids if psutil.pid_exists(pid)]


def test_four_slaves_and_four_planners_surround_the_target(
    scenario: Scenario, groups: list[ProcessGroup], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hunt_watch, "SETTLE_S", 1.0)
    watch = HuntWatch(scenario)
    costs = processes.fly(scenario, str(tmp_path), watch)
    outcome = watch.result()
    assert outcome.success, outcome
    assert watch.judgement.separation > 1.0
    assert outcome.duration < 2.0 * watch.plan.duration
    assert costs["energy"] > 50.0
    assert costs["commands measured"] > 4 * 0.5 * outcome.duration / scenario.master.command_period
    for member in scenario.member:
        output = (tmp_path / f"agent_{member.node}.log").read_text()
        counts = re.search(r"reports: (\d+) received, \d+ from out of range, (\d+) malformed", output)
        assert counts, output
        assert int(counts[1]) > 3 * 0.5 * outcome.duration / 0.1  # of three neighbours, ten a second
        assert int(counts[2]) == 0
        assert "thrusters neutral" in (tmp_path / f"slave_{member.node}.log").read_text()


def test_a_planner_that_ends_is_named_and_all_others_are_ended(
    scenario: Scenario, groups: list[ProcessGroup], tmp_path: Path
) -> None:
    class KillsThird(HuntWatch):
        def add_row(self, row: HuntRow) -> str:
            if len(self.rows) == 3:
                os.kill(groups[1].pids[2], signal.SIGKILL)
            return super().add_row(row)

    with pytest.raises(NetworkError, match=r"agent_uuv3 ended with exit code -9: uuv3: planning, reports at tcp/"):
        processes.fly(scenario, str(tmp_path), KillsThird(scenario))


def test_ctrl_c_ends_all_processes(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    with Program(tmp_path, "case", "target_hunting", "--hil", "--output", folder) as case:
        hil = folder / "target_hunting-hil-001"
        log = hil / "slave_uuv4.log"
        assert wait_for(lambda: log.exists() and "commands arrive" in log.read_text()), case.output
        mine = [pid for pid in psutil.pids() if str(hil) in command_line(pid)]
        assert len(mine) == 8
        assert case.stop(signal.SIGINT) == 130
        assert not [pid for pid in mine if psutil.pid_exists(pid)]
