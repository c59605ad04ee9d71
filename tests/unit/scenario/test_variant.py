"""Scenarios written to files: what is written is read back."""

import math
import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.common.errors import ConfigError
from hil.common.tables import parse_toml
from hil.scenario.config import load_scenario
from hil.scenario.variant import write_toml, write_variant
from sim.environment.world import load_world

WORDS = st.text(st.characters(blacklist_categories=["Cs", "Cc"]), max_size=12)
keys = st.text("abcdefghij_", min_size=1, max_size=6)
plain = st.one_of(
    WORDS, st.booleans(), st.integers(-(2**60), 2**60), st.floats(allow_nan=False), st.lists(st.floats(-9, 9))
)
tables = st.recursive(
    st.dictionaries(keys, plain, max_size=4),
    lambda inner: st.dictionaries(
        keys, st.one_of(plain, inner, st.lists(inner.filter(bool), min_size=1, max_size=3)), max_size=4
    ),
    max_leaves=8,
)


@given(tables)
def test_any_table_is_read_back_equal(tmp_path_factory: pytest.TempPathFactory, table: dict[str, Any]) -> None:
    path = tmp_path_factory.getbasetemp() / "any.toml"
    write_toml(str(path), table)
    assert parse_toml(path.read_text()) == table


def test_a_variant_equals_the_scenario_except_for_its_changes(tmp_path: Path) -> None:
    pile = {"north": 1.0, "east": 9.0, "radius": 0.5, "hidden": True}
    path = write_variant("task_scheduling", str(tmp_path), {"seed": 7, "slave.node": "other"}, {"cylinder": [pile]})
    preset, varied = load_scenario("task_scheduling"), load_scenario(path)
    assert varied.seed == 7
    assert varied.slave.node == "other"
    same = {"seed": 1, "path": preset.path, "world": preset.world, "slave": preset.slave, "sensors": preset.sensors}
    assert varied._replace(**same) == preset  # type: ignore[arg-type]
    assert varied.sensors["laser"].model == preset.sensors["laser"].model
    before, after = load_world(preset.world), load_world(varied.world)
    assert after.cylinder[:-1] == before.cylinder
    assert (after.cylinder[-1].north, after.cylinder[-1].hidden) == (1.0, True)
    assert after.box == before.box
    assert not any(math.isnan(edge) for edge in after.extent)
    with pytest.raises(ConfigError, match="cannot be written as TOML"):
        write_toml(str(tmp_path / "x.toml"), {"a": object()})


def test_paths_are_resolved_and_keys_removed(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/world.toml").write_text(Path("sim/worlds/pool.toml").read_text())
    source = tmp_path / "mine/mine.toml"
    source.write_text(
        'vehicle = "paper_six"\nworld = "world.toml"\n[start]\nnorth = 4\neast = 4\n[master]\ngoal = [8, 7]\n'
        "[sensors.imu]\nacceleration = {}\n[link.faults]\ndrop = 0.25\n"
    )
    changes = {"link.faults.drop": None, "description": 'a "b"\n\\\x7f'}
    before, after = load_scenario(str(source)), load_scenario(write_variant(str(source), str(tmp_path), changes))
    assert (after.description, after.sensors) == (changes["description"], before.sensors)
    assert after.link.faults is not None
    assert after.link.faults.drop == 0.0
    assert os.path.samefile(after.world, before.world)


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"link.baud": 3}, "baud"), ({"vehicle.name": "x"}, "is a value"), ({"slave.setp": 1}, "did you mean 'step'")],
)
def test_an_invalid_change_is_refused_by_its_key(tmp_path: Path, changes: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message) as error:
        write_variant("paper_field", str(tmp_path), changes)
    assert str(tmp_path) not in str(error.value), "a file that nobody knows"
