"""Files that we load fit their schema, and what a schema refuses the loader refuses too."""

import copy
import json
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from boards import load_board
from hil.cli import main
from hil.common.errors import ConfigError
from hil.common.schema import preset_folder
from hil.common.tables import parse_toml, read_table
from hil.links.frame.rules import load_layout
from hil.scenario.config import load_scenario
from hil.schemas.files import DRAFT, KINDS, schema
from sim.environment.world import load_world
from sim.vehicle.vehicle import load_vehicle
from tests.support.documents import ROOT, blocks

FOLDERS = {
    "scenario": "hil/scenario/presets", "vehicle": "sim/vehicles", "world": "sim/worlds", "board": "boards",
    "frame": "firmware_stub/frames",
}  # fmt: skip
OURS = [(kind, path) for kind, folder in FOLDERS.items() for path in sorted(Path(preset_folder(folder)).glob("*.toml"))]
LOAD: dict[str, Callable[[str], Any]] = {
    "scenario": load_scenario, "fleet": load_scenario, "vehicle": load_vehicle, "world": load_world,
    "board": load_board, "frame": load_layout,
}  # fmt: skip


@cache
def validator(kind: str) -> jsonschema.Draft7Validator:
    return jsonschema.Draft7Validator(schema(kind))


def faults(kind: str, table: dict[str, Any]) -> list[str]:
    return [f"{error.json_path}: {error.message[:200]}" for error in validator(kind).iter_errors(table)]


@pytest.mark.parametrize("kind", KINDS)
def test_every_schema_is_a_valid_json_schema(kind: str) -> None:
    jsonschema.Draft7Validator.check_schema(json.loads(json.dumps(schema(kind), allow_nan=False)))
    assert schema(kind)["$schema"] == DRAFT


@pytest.mark.parametrize(("kind", "path"), OURS, ids=lambda value: getattr(value, "stem", value))
def test_all_shipped_files_fit_their_schema(kind: str, path: Path) -> None:
    assert faults(kind, read_table(str(path))) == []


def test_a_fleet_needs_members() -> None:
    hunting, field = (read_table(f"{preset_folder(FOLDERS['scenario'])}/{name}.toml")
                      for name in ("target_hunting", "paper_field"))  # fmt: skip
    assert faults("fleet", hunting) == []
    assert any("'member' is a required property" in text for text in faults("fleet", field))


def whole_blocks() -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield the complete files that pages show: location, kind and content."""
    marks = {"mass": "vehicle", "extent": "world", "architecture": "board", "byte_order": "frame", "world": "scenario"}
    for block in blocks("toml"):
        table = parse_toml(block.text)
        kind = next((kind for key, kind in marks.items() if key in table), None)
        if kind:
            yield f"{block.page}:{block.line}", kind, table


@pytest.mark.parametrize(("location", "kind", "table"), list(whole_blocks()), ids=lambda value: str(value)[:40])
def test_files_shown_in_docs_fit_their_schema(location: str, kind: str, table: dict[str, Any]) -> None:
    assert faults(kind, table) == []


def test_every_block_shown_in_docs_fits_a_scenario() -> None:
    whole_files = {where for where, _, _ in whole_blocks()}
    field = {"vehicle": "paper_six", "world": "paper_field", "master": {"goal": [1.0, 2.0]}}
    count = 0
    for block in blocks("toml"):
        if f"{block.page}:{block.line}" not in whole_files:
            table = parse_toml(block.text)
            assert faults("scenario", field | table | {"master": field["master"] | table.get("master", {})}) == []
            count += 1
    assert count > 10


# A key by its dotted name, and a value that both the schema and the reader refuse.
WRONG = [
    ("scenario", "seed", -1), ("scenario", "seed", 1.5), ("scenario", "stm32", "pythn"),
    ("scenario", "slave.step", "2.5"), ("scenario", "slave.step", "2.5 kg"), ("scenario", "slave.step", 0.0),
    ("scenario", "master.sped", 1.0), ("scenario", "master.goal", [1.0]), ("scenario", "link.baud", "fast"),
    ("scenario", "sensors.imu.rat", 5), ("scenario", "sensors.sonr", {}), ("scenario", "planner.north", 5),
    ("scenario", "failure", [{"thruster": "a", "kind": "explodes"}]), ("scenario", "path", "x"),
    ("scenario", "modem.kind", "radio"), ("scenario", "link.faults.dorp", 0.1),
    ("vehicle", "mass", -1.0), ("vehicle", "mass", "9.7 m"), ("vehicle", "thrusters", "six"),
    ("vehicle", "every_thruster.curve", {"kind": "cubic"}), ("vehicle", "weight", 3),
    ("world", "depth", 0.0), ("world", "extent", [0.0, 1.0]), ("world", "ocean.waves", {"hight": 1}),
    ("world", "terrain", {"kind": "hill"}), ("world", "box", [{"north": 1.0}]),
    ("board", "cores", 1.5), ("board", "architecture", "mips"), ("board", "serial", [{}]),
    ("frame", "byte_order", "middle"), ("frame", "stuffing.type", "none of it"), ("frame", "sync", [256]),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "key", "value"), WRONG, ids=lambda value: str(value)[:30])
def test_wrong_values_are_refused_by_schema_and_loader(kind: str, key: str, value: Any, tmp_path: Path) -> None:
    path = next(path for each, path in OURS if each == kind and ("paper" in path.stem or kind in ("board", "frame")))
    table = copy.deepcopy(read_table(str(path)))
    inner = table
    *sections, last = key.split(".")
    for section in sections:
        inner = inner.setdefault(section, {})
    inner[last] = value
    assert faults(kind, table), "the schema accepts it"
    changed = tmp_path / "changed.toml"
    changed.write_text("".join(_toml(table)))
    with pytest.raises(ConfigError):
        LOAD[kind](str(changed))


@pytest.mark.parametrize("kind", FOLDERS)
def test_missing_keys_are_refused(kind: str, tmp_path: Path) -> None:
    path = next(path for each, path in OURS if each == kind)
    for key in schema(kind)["required"]:
        table = {name: value for name, value in read_table(str(path)).items() if name != key}
        assert any(f"'{key}' is a required property" in text for text in faults(kind, table))
        changed = tmp_path / "changed.toml"
        changed.write_text("".join(_toml(table)))
        with pytest.raises(ConfigError):
            LOAD[kind](str(changed))


def _toml(table: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of a table as TOML with all sub-tables inline."""
    for key, value in table.items():
        yield f"{key} = {_inline(value)}\n"


def _inline(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{" + ", ".join(f'"{key}" = {_inline(item)}' for key, item in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return (
        repr(value)
        if isinstance(value, (int, float))
        else '"' + str(value).replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
    )


def test_the_command_writes_every_schema(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenario", "schema", "-o", str(tmp_path)]) == 0
    assert {path.name for path in tmp_path.glob("*")} == {f"{kind}.schema.json" for kind in KINDS}
    capsys.readouterr()
    assert main(["scenario", "schema", "board"]) == 0
    assert capsys.readouterr().out == (tmp_path / "board.schema.json").read_text()
    assert main(["scenario", "schema"]) == 2
    assert main(["scenario", "schema", "bord"]) == 2
    assert "did you mean 'board'" in capsys.readouterr().err
    assert (ROOT / "docs/how-to/editor.md").exists()
