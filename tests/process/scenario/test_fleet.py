"""Scenario files of several vehicles: the part of each member, and errors that name the wrong key."""

from pathlib import Path
from typing import Any

import pytest

from hil.common.errors import ConfigError, MissionError
from hil.scenario.config import Scenario, load_scenario
from hil.scenario.fleet import as_member, hunt_plan, hunting_of

MEMBER = """
[[member]]
node = "{node}"
listen = "tcp/127.0.0.1:{port}"
agent = "tcp/127.0.0.1:{agent}"
north = {north}
east = 0
"""
HEAD = """
vehicle = "paper_seven"
world = "pool"
seed = 7
[start]
depth = 2
[master]
depth = 2
"""


def fleet(folder: Path, nodes: str = "a b c", tail: str = "", **changes: Any) -> Scenario:
    text = HEAD
    for number, node in enumerate(nodes.split()):
        row = {"node": node, "port": 7447 + 2 * number, "agent": 7467 + 2 * number, "north": 3 * number}
        text += MEMBER.format(**row | {key: value for key, value in changes.items() if number})
    path = folder / "fleet.toml"
    path.write_text(text + tail)
    return load_scenario(str(path))


def test_each_member_has_its_own_settings(tmp_path: Path) -> None:
    scenario = fleet(tmp_path)
    second = as_member(scenario, "b")
    assert as_member(scenario, "2") == second
    assert (second.slave.node, second.slave.listen) == ("b", "tcp/127.0.0.1:7449")
    assert (second.start.north, second.start.depth) == (3.0, 2.0)
    assert second.ros.frame_prefix == "b/"
    assert [as_member(scenario, node).ros.clock > 0.0 for node in "abc"] == [True, False, False]


def test_members_have_different_seeds(tmp_path: Path) -> None:
    scenario = fleet(tmp_path)
    seeds = {as_member(scenario._replace(seed=seed), node).seed for seed in range(50) for node in "abc"}
    assert len(seeds) == 150


def test_a_scenario_of_one_vehicle_has_no_members() -> None:
    with pytest.raises(ConfigError, match="is of one vehicle, not of a fleet"):
        as_member(load_scenario("paper_field"), "uuv1")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"node": "a"}, "node: two members have 'a'; give each its own"),
        ({"port": 7447}, "listen: two members have"),
        ({"agent": 7467}, "agent: two members have"),
        ({"node": "1a"}, r"member\[1\]: node: '1a' must be letters"),
        ({"north": '"far"'}, r"member\[1\]: north"),
    ],
)
def test_wrong_members_are_named(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        fleet(tmp_path, nodes="a b", **changes)


def test_a_hunt_plan_needs_a_hunt_and_three_members(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"there is no \[hunting\].*such as target_hunting"):
        hunting_of(fleet(tmp_path))
    with pytest.raises(MissionError, match="it takes three"):
        hunt_plan(fleet(tmp_path, nodes="a b", tail="[hunting]\ntarget = [5, 8]"))
    plan = hunt_plan(fleet(tmp_path, tail="[hunting]\ntarget = [5, 8]\nring = '2 m'"))
    assert (plan.starts[2], plan.target, plan.ring) == ((6.0, 0.0), (5.0, 8.0), 2.0)
