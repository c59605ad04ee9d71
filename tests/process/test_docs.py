"""The examples of the documentation run as printed: every block of Python, TOML and commands."""

import argparse
import importlib
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import boards
from hil.cases.simulated import fly
from hil.cli import COMMANDS, FAMILIES, find_command
from hil.cli import _help as command_help
from hil.commands.completion import find_parser
from hil.common.tables import parse_toml
from hil.master.flight import prepare
from hil.scenario.config import load_scenario
from sim.environment.world import load_world
from sim.vehicle.vehicle import load_vehicle
from tests.support.documents import PAGES, ROOT, Block, blocks, commands
from tests.support.processes import Program

PYTHON, TOML = blocks("python"), blocks("toml")
# Who runs the Python of a page: blocks of a file with a name are modules, of which the next TOML makes use (here);
# pages that talk to a vehicle are run beside a slave.
RUN_BESIDE_A_SLAVE = "tests/system/docs/test_python_docs.py"
RUNNERS = {
    "README.md": RUN_BESIDE_A_SLAVE, "docs/how-to/python.md": RUN_BESIDE_A_SLAVE,
    "docs/tutorials/two_machines.md": RUN_BESIDE_A_SLAVE,
    "docs/tutorials/ros1.md": "tests/system/gateways/test_ros1_debian.py",
    "docs/how-to/rosbridge.md": "tests/system/gateways/test_rosbridge_clients.py",
    "docs/reference/links.md": "beside an STM32", "docs/reference/sensors.md": "alone",
    "docs/how-to/record.md": "tests/system/docs/test_how_to_more.py",
    "docs/how-to/charts.md": "test_the_example_of_a_route_along_a_pipeline_runs",
}  # fmt: skip


def name_of(block: Block) -> str:
    return f"{block.page}:{block.line}"


def flatten(table: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the tables of a TOML file as {"sensors.laser.rate": 5}."""
    changes: dict[str, Any] = {}
    for key, value in table.items():
        changes |= flatten(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: value}
    return changes


@pytest.fixture
def modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Provide a folder with all modules of the pages in it, which Python finds."""
    for block in PYTHON:
        if block.file:
            (tmp_path / block.file).write_text(block.text)
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.invalidate_caches()
    yield tmp_path
    for path in tmp_path.glob("*.py"):
        sys.modules.pop(path.stem, None)


def test_every_python_block_is_run_by_a_test() -> None:
    assert len(PYTHON) >= 7
    for block in PYTHON:
        assert block.file or block.page in RUNNERS, f"{name_of(block)}: nobody runs this"


@pytest.mark.parametrize("block", [b for b in PYTHON if RUNNERS.get(b.page) == "alone"], ids=name_of)
def test_python_blocks_without_a_slave_run(block: Block) -> None:
    done = subprocess.run([sys.executable, "-c", block.text], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_the_example_of_the_link_library_runs(tmp_path: Path) -> None:
    (block,) = blocks("python", page=ROOT / "docs" / "reference" / "links.md")
    port = f"pty:{tmp_path / 'stm32'}"
    with Program(tmp_path, "stm32", "--port", port) as stm32:
        stm32.expect("Ctrl-C")
        script = block.text.replace("pty:/tmp/uuv-hil-stm32", port)
        done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    # A command that comes after the watchdog's time is answered too, so the loop ends on a busy machine as well.
    assert re.search(r"^(5\d|[6-9]\d|\d{3,}) \(1550, 1550, 1550, 1550, 1550, 1550\) \d+$", done.stdout, re.M)


# What a whole file has on its top level -> what reads it.
FILE_READERS: dict[str, Callable[[str], Any]] = {
    "mass": load_vehicle,
    "extent": load_world,
    "architecture": boards.load_board,
    "world": load_scenario,
}


def reader_of(table: dict[str, Any]) -> Callable[[str], Any] | None:
    """Return the reader of a block that is a whole file; None for a part of a scenario."""
    return next((load for key, load in FILE_READERS.items() if key in table), None)


@pytest.mark.parametrize("block", [b for b in TOML if not reader_of(parse_toml(b.text))], ids=name_of)
def test_toml_blocks_are_valid_parts_of_a_scenario(block: Block, modules: Path) -> None:
    """Every key of it is read, with the classes that it names; in a fleet if it is about one."""
    table = parse_toml(block.text)
    base = "target_hunting" if "modem" in table else "paper_field"
    scenario = load_scenario(base, flatten(table))
    for section in table:
        assert getattr(scenario, section), f"{name_of(block)}: [{section}]"


@pytest.mark.parametrize("page", sorted({b.page for b in TOML if reader_of(parse_toml(b.text))}))
def test_toml_blocks_of_whole_files_are_valid(page: str, tmp_path: Path) -> None:
    """The files are read in the order of the page: a scenario names the world of an earlier block."""
    for number, block in enumerate(blocks("toml", page=ROOT / page)):
        load = reader_of(parse_toml(block.text))
        if load:
            path = tmp_path / (re.findall(r"`(\w+\.toml)`", block.before) or [f"{number}.toml"])[-1]
            path.write_text(block.text)
            for name in re.findall(r'^file = "(\w+\.glb)"', block.text, flags=re.MULTILINE):
                pytest.importorskip("trimesh").creation.box((4.0, 2.0, 3.0)).export(tmp_path / name)
            assert load(str(path))


def test_the_documentation_has_toml_of_the_main_sections() -> None:
    assert {section for block in TOML for section in re.findall(r"^\[+([a-z_]+)", block.text, flags=re.MULTILINE)} >= {
        "planner", "sensors", "modem", "slave", "network",
    }  # fmt: skip


def fly_example(time_limit: float = 60.0, **position: float) -> Any:
    """Return the tutorial's planner in the reference field."""
    (text,) = [block for block in TOML if "straight:Straight" in block.text]
    planner = parse_toml(text.text)["planner"] | position
    scenario = load_scenario("paper_field", {"planner": planner, "master": {"time_limit": time_limit}})
    outcome, _ = fly(scenario, prepare(scenario))
    return outcome


def test_the_planner_of_the_tutorial_reaches_its_goal(modules: Path) -> None:
    outcome = fly_example()
    assert outcome.success, outcome.verdict
    assert outcome.verdict == "goal reached"
    assert not outcome.events
    assert outcome.least_clearance > 1.0


def test_a_goal_inside_a_pile_is_no_success(modules: Path) -> None:
    """A vehicle that touches the pile is held there by friction, and the run reports it."""
    outcome = fly_example(25.0, north=8.0, east=7.0, depth=2.0)
    assert not outcome.success
    assert outcome.verdict.endswith("collision with the pile at (6.5, 7.5)")
    assert sum(event.duration_ns for event in outcome.events) > 5e9


def test_the_example_of_a_route_along_a_pipeline_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A world of the same page takes the place of a chart's."""
    code, *_ = (block for block in PYTHON if block.page == "docs/how-to/charts.md")
    world, *_ = (block for block in TOML if block.page == code.page and "[[pipeline]]" in block.text)
    (tmp_path / "farm.toml").write_text(world.text)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(code.text, names)  # our own page
    first, *_, last = names["route"]
    assert first == pytest.approx((-40.0, -10.0, 16.0), abs=0.5)
    assert last == pytest.approx((40.0, 5.0, 16.0), abs=0.5)


class Parsed(BaseException):
    """Raised when the arguments were accepted, instead of running the command."""


@pytest.fixture
def parse_only(monkeypatch: pytest.MonkeyPatch) -> None:
    def stopping(parse: Callable[..., object]) -> Callable[..., None]:
        def stop(parser: argparse.ArgumentParser, arguments: Any = None, namespace: Any = None) -> None:
            parse(parser, arguments, namespace)
            raise Parsed

        return stop

    for method in ("parse_args", "parse_intermixed_args"):
        monkeypatch.setattr(argparse.ArgumentParser, method, stopping(getattr(argparse.ArgumentParser, method)))
    from hil.commands import slave

    monkeypatch.setattr(slave, "_parse_plain", lambda arguments: None)
    monkeypatch.setattr(shutil, "which", lambda program, **_: program)  # nothing needs to be installed here


def examples() -> list[tuple[str, str]]:
    """Return the commands in the examples of every --help, those of all commands and of all benchmarks too."""
    texts = [(name, find_parser(module).epilog or "") for name, (module, _) in COMMANDS.items()]
    problems = []
    for name, text in [*texts, ("uuv-hil", command_help())]:
        lines = re.findall(r"^ +(?:.*[|/ ])?uuv-hil (.*)$", text.replace("\\\n", " "), flags=re.MULTILINE)
        # What follows two spaces is a remark.
        problems += [(f"{name} --help", re.sub(r"\s{2,}.*$|\s+[&>].*$", "", line)) for line in lines]
    return problems


@pytest.mark.usefixtures("parse_only")
def test_the_arguments_of_commands_are_accepted(capsys: pytest.CaptureFixture[str]) -> None:
    for location, line in [*commands(), *examples()]:
        name, arguments = find_command(shlex.split(line.partition(" > ")[0]))
        if name in FAMILIES and arguments == ["--help"]:
            continue
        assert name in COMMANDS, f"{location}: {name}"
        try:
            with pytest.raises(Parsed):
                importlib.import_module(COMMANDS[name][0]).main(arguments)
        except SystemExit as refusal:
            if refusal.code:  # not --help
                pytest.fail(f"{location}: uuv-hil {line}\n{capsys.readouterr().err}")


def test_commands_of_pages_and_help_texts_are_found() -> None:
    assert len(commands()) > 20
    assert len(examples()) > 90
    assert {where for where, _ in examples()} >= {f"{name} --help" for name in COMMANDS}
    assert any("set_parameters" in line and "value" in line for _, line in commands()), "a line that goes on"


def test_pages_tune_vehicle_files_only() -> None:
    """No page tunes a scenario file: `tune` takes a vehicle file."""
    lines = [line for page in PAGES for line in page.read_text().splitlines() if line.strip().startswith("uuv-hil ")]
    tuned = [line for line in lines if "uuv-hil tune " in line]
    assert tuned
    assert not any("mine.toml" in line for line in tuned)
