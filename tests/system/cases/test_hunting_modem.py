"""Target hunting with modem communication, in simulated time."""

import math
from pathlib import Path
from typing import Any

import pytest

from hil.cases.hunt.simulated import SimulatedHunt
from hil.cases.hunt.watch import HuntWatch
from hil.cases.record import Result
from hil.scenario.config import load_scenario
from tests.support.processes import Program

SCENARIO = "target_hunting_acoustic"


def hunt(changes: dict[str, Any], seconds: float = 1e9) -> tuple[SimulatedHunt, Result]:
    scenario = load_scenario(SCENARIO, changes)
    watch = HuntWatch(scenario)
    simulated = SimulatedHunt(scenario, watch)
    while not watch.reason and simulated.time < seconds:
        simulated.step()
    return simulated, watch.result()


def test_acoustic_messages_in_tdma_slots_all_arrive_and_the_target_is_surrounded() -> None:
    simulated, outcome = hunt({"seed": 7})
    assert outcome.success, outcome
    assert outcome.extra["least distance between two vehicles (m)"] > 1.2
    assert simulated.channel
    counts = simulated.channel.counts
    assert counts["sent"] == pytest.approx(4 * outcome.duration, abs=8)  # each once a second
    assert set(counts) == {"sent", "delivered"}
    assert sum(planner.received for planner in simulated.planners) == counts["delivered"]
    assert counts["delivered"] > 3 * (counts["sent"] - 4)
    assert all(planner.malformed == 0 for planner in simulated.planners)


def test_a_neighbour_is_extrapolated_from_its_last_report() -> None:
    """A report is 0.25 to 1.25 s old, yet gives the neighbour's own present estimate but for a few cm."""
    simulated, _ = hunt({"hunting.noise": 0.0}, 12.0)
    planner, neighbour = simulated.planners[:2]
    output, report = planner._present("uuv2"), planner._reports["uuv2"].report
    assert neighbour._own_sample
    assert 0.2 < output.clock - report.clock < 1.4
    assert output.clock == pytest.approx(neighbour.clock, abs=0.4)
    assert math.dist(output.position, neighbour._own_sample.position[:2]) < 0.06
    assert math.dist(report.position, neighbour._own_sample.position[:2]) > 0.08


def test_messages_collide_without_tdma_slots() -> None:
    changes = {"modem.slot": 0, "hunting.report_period": 1.0}
    simulated, _ = hunt(changes, 30.0)
    assert simulated.channel
    counts = simulated.channel.counts
    assert counts["sent"] == pytest.approx(4 * 30, abs=16)
    assert counts["collided"] > 30
    assert counts["deaf"] > 30
    assert counts["delivered"] < 0.8 * 3 * counts["sent"]
    assert hunt(changes, 30.0)[0].channel.counts == counts  # type: ignore[union-attr]


def test_the_channel_command_needs_a_modem_in_the_scenario(tmp_path: Path) -> None:
    for scenario in ("target_hunting", "paper_field"):  # with and without a fleet
        with Program(tmp_path, "fleet", "channel", scenario) as water:
            assert water.wait() == 2
            assert "there is no [modem]" in water.output
            assert "such as target_hunting_acoustic" in water.output
    with Program(tmp_path, "fleet", "channel", SCENARIO) as water:
        water.expect("acoustic modems of 4 vehicles, slots of 0.25 s")
        assert water.stop(15) == 0, water.output
    assert water.output.strip().endswith("nothing sent")
