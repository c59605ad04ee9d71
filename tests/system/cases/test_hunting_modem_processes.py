"""Target hunting by modem, with a process for each slave and planner and the acoustic channel between them."""

import re
from pathlib import Path

import pytest

from hil.cases.hunt import processes
from hil.cases.hunt import watch as hunt_watch
from hil.cases.hunt.watch import HuntWatch
from hil.cases.target_hunting import members_on_free_ports
from hil.scenario.config import load_scenario
from hil.scenario.variant import write_variant

SCENARIO = "target_hunting_acoustic"
STARTS = ((6.2, 7.1), (3.0, 6.4), (3.0, 3.6), (6.2, 2.9))  # half round the target already, 2.4 m from it


def test_four_processes_hunt_over_the_acoustic_channel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Agents receive exactly the messages that the channel delivers."""
    monkeypatch.setattr(hunt_watch, "SETTLE_S", 1.0)
    members = members_on_free_ports(SCENARIO)
    for table, (north, east) in zip(members, STARTS, strict=True):
        table.update(north=north, east=east)
    changes = {"member": members, "hunting.target": [5.0, 5.0]}
    scenario = load_scenario(write_variant(SCENARIO, str(tmp_path), changes))
    watch = HuntWatch(scenario)
    costs = processes.fly(scenario, str(tmp_path), watch)
    outcome = watch.result()
    assert outcome.success, outcome
    assert watch.judgement.separation > 1.0
    assert costs["modem: sent"] >= 3 * outcome.duration
    assert costs["modem: delivered"] >= 0.8 * 3 * (costs["modem: sent"] - 4)
    received = 0
    for member in scenario.member:
        output = (tmp_path / f"agent_{member.node}.log").read_text()
        found = re.search(r"reports: (\d+) received, \d+ from out of range, 0 malformed", output)
        assert found, output
        received += int(found[1])
    assert received == pytest.approx(costs["modem: delivered"], abs=12)
