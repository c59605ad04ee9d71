"""Imports go down the floors only, and the slave's core stays lean."""

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("hil", "sim", "boards", "firmware_stub")

# From the ground up; a module may import what is on its own floor or below.
FLOORS = {
    "hil.errors": 0, "hil.tables": 0, "hil.schema": 0, "hil.plugins": 0, "hil.columns": 0, "hil.clock": 0,
    "hil.quantiles": 0, "hil.stop": 0, "hil.process": 0, "hil.ports": 0,
    "sim": 1, "boards": 1, "hil.autonomy": 1,
    "hil.config": 2, "hil.fleet": 2, "hil.modem": 2, "hil.topics": 2, "hil.links": 2, "hil.transport": 2,
    "firmware_stub": 3,
    "hil.slave": 4, "hil.master": 4,
    "hil.bench": 5, "hil.charts": 5, "hil.cases": 5, "hil.commands": 6, "hil.cli": 7,
}  # fmt: skip
# Rooms on one floor that know nothing of each other.
STRANGERS = [
    ("sim", "hil.autonomy"), ("sim", "boards"), ("hil.autonomy", "sim"), ("hil.autonomy", "boards"), ("boards", "sim"),
    ("hil.links", "hil.transport"), ("hil.links", "hil.config"), ("hil.links", "sim"), ("firmware_stub", "sim"),
    ("firmware_stub", "hil.transport"), ("firmware_stub", "hil.config"),
    ("hil.slave", "hil.master"), ("hil.master", "hil.slave"), ("hil.master", "hil.links"),
]  # fmt: skip


def modules() -> Iterator[tuple[str, Path]]:
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            yield name.removesuffix(".__init__"), path


def room(module: str) -> str | None:
    """The row of FLOORS a module belongs to: the longest that it begins with."""
    fitting = [name for name in FLOORS if module == name or module.startswith(name + ".")]
    return max(fitting, key=len, default=None)


def imported(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path}: relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@pytest.mark.parametrize(("module", "path"), [pytest.param(*row, id=row[0]) for row in modules()])
def test_imports_go_down(module: str, path: Path) -> None:
    if module == "hil":
        at_once = [node for node in ast.parse(path.read_text()).body if isinstance(node, (ast.Import, ast.ImportFrom))]
        assert not at_once, "importing a part of hil must not cost more than that part"
        return  # what `hil.connect` imports, it imports when it is called
    own = room(module)
    assert own is not None, f"{module} has no floor: add its room to FLOORS"
    for name in imported(path):
        if name.split(".")[0] not in PACKAGES:
            continue
        other = room(name)
        lazily = module.startswith("hil.slave.stm32_") and other == "firmware_stub"
        assert other is None or FLOORS[other] <= FLOORS[own] or lazily, f"{module} imports {name}, which is above it"
        assert (own, other) not in STRANGERS, f"{module} imports {name}"


def test_every_floor_has_modules() -> None:
    rooms = {room(module) for module, _ in modules()}
    assert rooms >= set(FLOORS)


def test_no_module_is_named_like_a_dependency() -> None:
    names = {path.stem for _, path in modules()}
    assert not names & {"serial", "can", "zenoh", "numpy", "scipy", "psutil", "dronecan", "pymavlink", "matplotlib"}


def test_tools_are_not_imported_by_what_is_installed() -> None:
    for module, path in modules():
        assert not [name for name in imported(path) if name.split(".")[0] in ("tools", "tests")], module


LEAN = """
import sys
before = set(sys.modules)
import hil.commands.slave, hil.slave.daemon, hil.slave.stm32, firmware_stub.stub, boards
import sim.simulation
heavy = {"numpy", "scipy", "asyncio", "can", "serial", "matplotlib", "pymavlink", "dataclasses", "inspect", "email",
         "moderngl", "ssl", "logging", "psutil", "subprocess", "ctypes", "pathlib", "json",
         "hil.autonomy.astar", "hil.autonomy.families", "hil.master"}
print(*sorted(heavy & set(sys.modules)))
"""


def test_the_slave_loads_nothing_heavy() -> None:
    done = subprocess.run([sys.executable, "-c", LEAN], capture_output=True, text=True, cwd=ROOT, env={**os.environ})
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [], "the slave's start-up and memory are headline figures: import these when used"
