"""The command line: a missing package and a full disk are a line with the remedy."""

import errno
import os
import re
import sys
from importlib.metadata import distributions
from pathlib import Path
from types import SimpleNamespace

import pytest

from hil import cli
from hil.common.tables import parse_toml
from tests.support.processes import ROOT, Program, free_port

# Read by Python as it starts: the packages it names are not to be found.
HIDING = """
import os
from importlib.machinery import PathFinder

find = PathFinder.find_spec
hidden = os.environ["HIDDEN"].split()
PathFinder.find_spec = lambda name, *more: None if name.split(".")[0] in hidden else find(name, *more)
"""


def run_without(tmp_path: Path, packages: str, *arguments: object) -> str:
    """Return the line of a command that ends with the exit code of a missing extra."""
    (tmp_path / "sitecustomize.py").write_text(HIDING)
    environment = {"PYTHONPATH": str(tmp_path), "HIDDEN": packages}
    with Program(tmp_path, *arguments, environment=environment) as program:
        assert program.wait() == 5, program.output
    (line,) = program.output.strip().splitlines()
    return line


@pytest.mark.parametrize(
    "arguments",
    [
        ["demo", "--listen", f"tcp/127.0.0.1:{free_port()}", "--output", "{}/run"],
        ["sim", "paper_field", "--fast"],
        ["bench", "table"],
    ],
)
def test_commands_without_numpy_name_the_extra(tmp_path: Path, arguments: list[str]) -> None:
    words = [word.format(tmp_path) for word in arguments]
    line = run_without(tmp_path, "numpy joblib matplotlib xacro", *words)
    assert line.startswith("uuv-hil ")  # for the demo it is its master that says so
    assert line.endswith("pip install 'uuv-hil[master]'")


def extras() -> dict[str, set[str]]:
    """Return the distributions of each extra of pyproject.toml but those of the project itself."""
    tables = parse_toml((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    names = {extra: {re.split(r"[^\w.-]", text)[0].lower() for text in texts} for extra, texts in tables.items()}
    del names["dev"], names["docs"]
    return names


def test_each_package_is_in_its_extra_and_none_is_missing() -> None:
    known: dict[str, set[str]] = {}  # packages_distributions() of Python 3.10 does not find those without top_level.txt
    for distribution in distributions():
        name = distribution.metadata["Name"].lower()
        for line in (distribution.read_text("RECORD") or "").splitlines():
            known.setdefault(re.split("[/.,]", line, maxsplit=1)[0], set()).add(name)
    found = [(extra, known[package]) for package, extra in cli.EXTRAS.items()]
    for extra, names in found:
        assert names & extras()[extra], f"{names} is not in [{extra}]"
    reported = {name for _, names in found for name in names}
    assert set.union(*extras().values()) <= reported


@pytest.mark.parametrize("name", ["hil.commands.nowhere", "a_module_of_the_users", "numpy.nowhere", "zenoh"])
def test_a_missing_module_of_no_extra_is_not_hidden(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(arguments: list[str]) -> int:
        raise ModuleNotFoundError(name=name)

    monkeypatch.setattr(cli, "import_module", lambda module: SimpleNamespace(main=fail))
    with pytest.raises(ModuleNotFoundError):
        cli.main(["demo"])


@pytest.mark.parametrize(
    ("number", "code"), [(errno.ENOSPC, 3), (errno.EDQUOT, 3), (errno.EFBIG, 3), (errno.EPIPE, 141)]
)
def test_a_full_disk_is_one_line(
    number: int, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cli, "import_module", lambda module: SimpleNamespace(main=fail))
    monkeypatch.setattr(sys.stderr, "close", lambda: None)

    def fail(arguments: list[str]) -> int:
        raise OSError(number, os.strerror(number), "run/table.json")

    assert cli.main(["master"]) == code
    output = capsys.readouterr().err
    assert output == (f"uuv-hil master: run/table.json: {os.strerror(number)}; free some space\n" if code == 3 else "")
