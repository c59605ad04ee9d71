"""The hunt by modem: in simulated time, and with a process for each slave and planner and the water between them."""

import math
import re
from pathlib import Path
from typing import Any

import pytest

from hil.cases import hunt_processes, hunt_watch
from hil.cases.hunt_simulated import SimulatedHunt
from hil.cases.hunt_watch import HuntOutcome, HuntWatch
from hil.cases.target_hunting import TargetHuntingAcoustic, members_on_free_ports
from hil.cases.variant import write_variant
from hil.config import load_scenario
from tests.processes import Program

SCENARIO = "target_hunting_acoustic"
STARTS = ((6.2, 7.1), (3.0, 6.4), (3.0, 3.6), (6.2, 2.9))  # half round the target already, 2.4 m from it


def hunt(changes: dict[str, Any], seconds: float = 1e9) -> tuple[SimulatedHunt, HuntOutcome]:
    scenario = load_scenario(SCENARIO, changes)
    watch = HuntWatch(scenario)
    simulated = SimulatedHunt(scenario, watch)
    while not watch.reason and simulated.time < seconds:
        simulated.step()
    return simulated, watch.outcome()


def test_by_sound_in_slots_nothing_is_lost_and_the_target_is_surrounded() -> None:
    simulated, outcome = hunt({"seed": 7})
    assert outcome.success, outcome
    assert outcome.judgement.separation > 1.2
    assert simulated.channel
    counts = simulated.channel.counts
    assert counts["sent"] == pytest.approx(4 * outcome.duration, abs=8)  # each once a second
    assert set(counts) == {"sent", "delivered"}
    assert sum(planner.heard for planner in simulated.planners) == counts["delivered"]
    assert counts["delivered"] > 3 * (counts["sent"] - 4)
    assert all(planner.malformed == 0 for planner in simulated.planners)


def test_a_neighbour_is_where_it_said_and_has_gone_on_since() -> None:
    """Known a quarter to one and a quarter of a second late, yet where it takes itself to be now, but for a few cm."""
    simulated, _ = hunt({"hunting.noise": 0.0}, 12.0)
    planner, neighbour = simulated.planners[:2]
    said, report = planner._present("uuv2"), planner._reports["uuv2"].report
    assert neighbour._here
    assert 0.2 < said.clock - report.clock < 1.4
    assert said.clock == pytest.approx(neighbour.clock, abs=0.4)
    assert math.dist(said.position, neighbour._here.position[:2]) < 0.06
    assert math.dist(report.position, neighbour._here.position[:2]) > 0.08


def test_without_slots_messages_collide() -> None:
    changes = {"modem.slot": 0, "hunting.report_period": 1.0}
    simulated, _ = hunt(changes, 30.0)
    assert simulated.channel
    counts = simulated.channel.counts
    assert counts["sent"] == pytest.approx(4 * 30, abs=16)
    assert counts["collided"] > 30
    assert counts["deaf"] > 30
    assert counts["delivered"] < 0.8 * 3 * counts["sent"]
    assert hunt(changes, 30.0)[0].channel.counts == counts  # type: ignore[union-attr]


def test_by_light_as_far_as_it_reaches() -> None:
    clear = {"modem": {"kind": "optical", "slot": "50 ms"}}
    simulated, _ = hunt(clear, 5.0)
    assert simulated.channel
    assert simulated.channel.counts["delivered"] == pytest.approx(5.0 * 20 * 3, abs=15)
    harbour = {"modem": {"kind": "optical", "slot": "50 ms", "attenuation": 2.2}}
    simulated, _ = hunt(harbour, 5.0)
    assert simulated.channel
    assert simulated.channel.counts["unheard"] > 50
    assert "uuv4" not in simulated.planners[0].neighbours


def test_the_case_reports_what_became_of_messages() -> None:
    from hil.cases.target_hunting import _messages

    assert TargetHuntingAcoustic.scenario == SCENARIO
    assert _messages({}) == {}
    assert _messages({"sent": 3, "collided": 2})["modem: collided"] == 2


def test_in_processes_with_the_water_between_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Agents hear what the water delivers and nothing else."""
    monkeypatch.setattr(hunt_watch, "SETTLE_S", 1.0)
    members = members_on_free_ports(SCENARIO)
    for table, (north, east) in zip(members, STARTS, strict=True):
        table.update(north=north, east=east)
    changes = {"member": members, "hunting.target": [5.0, 5.0]}
    scenario = load_scenario(write_variant(SCENARIO, str(tmp_path), changes))
    watch = HuntWatch(scenario)
    costs = hunt_processes.fly(scenario, str(tmp_path), watch)
    outcome = watch.outcome()
    assert outcome.success, outcome
    assert outcome.judgement.separation > 1.0
    counts = costs.messages
    assert counts["sent"] >= 3 * outcome.duration
    assert counts["delivered"] >= 0.8 * 3 * (counts["sent"] - 4)
    heard = 0
    for member in scenario.member:
        said = (tmp_path / f"agent_{member.node}.log").read_text()
        found = re.search(r"reports: (\d+) heard, \d+ from out of range, 0 malformed", said)
        assert found, said
        heard += int(found[1])
    assert heard == pytest.approx(counts["delivered"], abs=12)


def test_the_command_says_what_it_needs(tmp_path: Path) -> None:
    with Program(tmp_path, "water", "target_hunting") as water:
        assert water.wait(20) == 2
        assert "there is no [modem]" in water.output
    with Program(tmp_path, "water", SCENARIO) as water:
        water.expect("acoustic modems of 4 vehicles, slots of 0.25 s")
        assert water.stop(15) == 0, water.output
    assert water.output.strip().endswith("nothing sent")
