"""The package structure: imports go in one direction, the slave loads few modules, the picture is current."""

import ast
import os
import re
import subprocess
import sys
from collections import Counter
from itertools import pairwise

from tools.pages import rooms

# Rooms on one floor, or one floor apart, that must not know each other, whatever the floors permit.
APART = {
    ("hil.links", "hil.ros"), ("hil.links", "sim"), ("firmware_stub", "sim"), ("firmware_stub", "hil.ros"),
    ("hil.slave", "hil.master"), ("hil.master", "hil.slave"), ("hil.master", "hil.links"),
    ("hil.slave", "hil.gateways"), ("hil.gateways", "hil.slave"), ("hil.client", "hil.links"),
    ("hil.gateways", "hil.links"),
    ("sim", "hil.autonomy"), ("sim", "boards"), ("hil.autonomy", "sim"), ("hil.autonomy", "boards"), ("boards", "sim"),
}  # fmt: skip


def test_imports_go_from_higher_to_lower_floors() -> None:
    up = [f"{one} -> {other}" for one, other in rooms.arrows() if rooms.FLOOR[other] > rooms.FLOOR[one]]
    assert not up
    assert not rooms.arrows() & APART


def test_a_room_imports_from_another_only_what_that_names_as_public() -> None:
    across = {(one, other) for one, others in rooms.graph().items() for other in others if not rooms.is_public(other)}
    assert [f"{one} -> {other}" for one, other in across if rooms.room(one) != rooms.room(other)] == []
    assert sum(not rooms.is_public(module) for module, _ in rooms.modules()) > 200


def test_rooms_of_one_floor_do_not_import_each_other_mutually() -> None:
    arrows = rooms.arrows()
    assert not [pair for pair in arrows if pair[::-1] in arrows]


def test_there_are_no_circular_imports() -> None:
    assert rooms.import_cycle() == []


def test_every_room_has_a_docstring_with_purpose_and_interface() -> None:
    """Each folder states its purpose, its public interface and what it must not know; hil/commands does so for all."""
    files = [path for _, path in rooms.modules() if path.name == "__init__.py" and path.parent.name != "hil"]
    assert len(files) > 60
    for path in files:
        text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        is_complete = re.search(r"\bPublic\b", text) and "must not" in " ".join(text.split())
        assert is_complete or path.parents[1].name == "commands", path


def test_neighbouring_folders_do_not_import_each_other_mutually() -> None:
    """The folders of one room have an order, too; a file that two of them need belongs to the folder above."""
    folders = {name for name, path in rooms.modules() if path.name == "__init__.py"}
    arrows = set()
    for module, others in rooms.graph().items():
        for other in others:
            one, two = (name if name in folders else name.rpartition(".")[0] for name in (module, other))
            if one != two and not f"{one}.".startswith(f"{two}.") and not f"{two}.".startswith(f"{one}."):
                arrows.add((one, two))
    assert len(arrows) > 100
    assert not [pair for pair in arrows if pair[::-1] in arrows]


def test_a_folder_holds_at_most_20_modules() -> None:
    """The limit holds for installed packages, tools, tests and what supports them."""
    roots = [rooms.ROOT / name for name in (*rooms.PACKAGES, "tools", "tests")]
    count = Counter(path.parent for root in roots for path in root.rglob("*.py") if path.stem != "__init__")
    assert len(count) > 100
    assert {str(folder): number for folder, number in count.items() if number > 20} == {}


def test_files_have_less_than_400_lines_and_functions_less_than_60() -> None:
    """Files of Python, C and MATLAB, and functions of Python, in the installed packages, tools and tests."""
    roots = [rooms.ROOT / name for name in (*rooms.PACKAGES, "tools", "tests")]
    long = []
    for path in (path for root in roots for path in root.rglob("*.*") if path.suffix in (".py", ".c", ".h", ".m")):
        long += [str(path)] if path.read_bytes().count(b"\n") >= 400 else []
        functions = rooms.imports_and_functions(path)[1] if path.suffix == ".py" else []
        long += [f"{path}: {name}" for name, lines in functions if lines >= 60]
    assert not long


def test_packages_import_neither_relatively_nor_from_tools_and_tests() -> None:
    for module, path in rooms.modules():
        assert not re.search(r"^\s*from\s*\.", path.read_text(encoding="utf-8"), re.MULTILINE), module
        names = rooms.imports_and_functions(path)[0]
        assert not [name for name in names if name.split(".")[0] in ("tools", "tests")], module


def test_importing_a_module_loads_only_what_it_needs() -> None:
    """`hil` and `sim` import a public name only when it is used."""
    body = ast.parse((rooms.ROOT / "hil/__init__.py").read_text(encoding="utf-8")).body
    names = [ast.unparse(node) for node in body if isinstance(node, (ast.Import, ast.ImportFrom))]
    assert names == [
        "import os",
        "import sys",
        "from hil.common import __version__ as __version__",
        "from hil.common.public import public_name",
    ]


def test_no_module_has_the_name_of_a_dependency() -> None:
    names = {path.stem for _, path in rooms.modules()}
    assert not names & {
        "serial",
        "can",
        "zenoh",
        "numpy",
        "scipy",
        "psutil",
        "dronecan",
        "pymavlink",
        "matplotlib",
        "mcap",
    }


def test_the_command_and_sample_paths_follow_the_imports() -> None:
    """One of two rooms in a row imports the other, or the slave reaches it by a table of names."""
    known_arrows = rooms.arrows() | {("hil.slave", "firmware_stub")}
    for way in (rooms.COMMAND, rooms.SAMPLE):
        for one, other in pairwise(way):
            met = {(one, other), (other, one)} & known_arrows
            by_slave = {("hil.slave", one), ("hil.slave", other)} <= known_arrows
            assert met or by_slave, f"{one} -> {other}"


def test_the_picture_shows_all_rooms_by_floor_and_both_paths() -> None:
    picture = rooms.PICTURE.read_text(encoding="utf-8")
    shown = re.findall(r'class="room">(.*?)</text>\n<text.*?>(.*?)</text>', picture)
    assert shown == [room for floor in reversed(rooms.FLOORS) for room in floor.items()]
    steps = [name.removeprefix("hil.") for name in (*rooms.COMMAND, *rooms.SAMPLE)]
    assert re.findall(r'class="step">(.*?)</text>', picture) == steps


LEAN = """
import sys
before = set(sys.modules)
import hil.commands.slave, hil.slave.daemon, hil.slave.drivers.driver, firmware_stub.stub, boards
import sim.simulation
heavy = {"numpy", "scipy", "asyncio", "can", "serial", "matplotlib", "pymavlink", "dataclasses", "inspect", "email",
         "ssl", "logging", "psutil", "subprocess", "ctypes", "pathlib", "json",
         "hil.autonomy.paths.astar", "hil.autonomy.control.families", "hil.master"}
print(*sorted(heavy & set(sys.modules)))
"""


def test_the_slave_loads_no_large_libraries() -> None:
    run = subprocess.run(
        [sys.executable, "-c", LEAN], capture_output=True, text=True, cwd=rooms.ROOT, env={**os.environ}
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == [], "the slave's start-up and memory are headline figures: import these when used"
