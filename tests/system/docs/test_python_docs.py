"""The programs of the pages about Python run unchanged except for the endpoint."""

import re
import subprocess
import sys
from collections.abc import Iterator

import pytest

from tests.support.documents import blocks
from tests.support.processes import ROOT, Program, free_port

BEGINNING, *PROGRAMS = [block.text for block in blocks("python", page=ROOT / "docs" / "how-to" / "python.md")]
(TUTORIAL,) = [block.text for block in blocks("python", page=ROOT / "docs" / "tutorials" / "two_machines.md")]
(README,) = [block.text for block in blocks("python", page=ROOT / "README.md")]


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with Program(tmp_path_factory.mktemp("slave"), "slave", "paper_field", "--listen", endpoint) as slave:
        slave.expect("ready")
        yield endpoint


def run(program: str, endpoint: str) -> list[str]:
    code = re.sub(r"tcp/[\d.]+:7447", endpoint, program)
    assert endpoint in code
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=40)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_the_program_of_the_readme_flies(endpoint: str) -> None:
    *_, last = run(README, endpoint)
    assert 0.4 < float(last.split()[0]) < 0.7
    assert last.endswith("m above the seabed")


def test_the_complete_program_runs(endpoint: str) -> None:
    first, *way, last = run(PROGRAMS[0], endpoint)
    assert re.fullmatch(r"uuv1: \d\.\d m deep, heading -?\d\.\d\d rad, \d+ ms old", first)
    assert sum("m/s ahead" in line for line in way) > 20
    assert "no 'gps'" in last


def test_the_program_with_a_dubins_path_runs(endpoint: str) -> None:
    length, arrival = run(PROGRAMS[1], endpoint)
    assert re.fullmatch(r"\d\.\d m in [1-3] pieces", length)
    assert float(length.split()[0]) >= 2.0, "no shorter than the straight line"
    assert 1.7 <= float(arrival.removeprefix("arrived ").removesuffix(" m east")) <= 2.3  # done within 0.3 m


def test_the_asyncio_program_runs(endpoint: str) -> None:
    pressures = [float(line.removesuffix(" Pa")) for line in run(PROGRAMS[2], endpoint)]
    assert pressures[0] - pressures[-1] > 1500, "0.3 m up are 3 kPa less, and 0.1 m are enough"


def test_the_page_has_three_programs() -> None:
    assert len(PROGRAMS) == 3


def test_the_first_lines_of_the_page_run(endpoint: str) -> None:
    """The first two lines of the page become a program with one more line."""
    assert run(f"{BEGINNING}print(fleet.wait_for('uuv1')[0].name)\nfleet.close()\n", endpoint) == ["uuv1"]


def test_the_program_of_the_tutorial_runs(endpoint: str) -> None:
    assert len(TUTORIAL.strip().splitlines()) <= 12
    lines = run(TUTORIAL, endpoint)
    assert float(lines[-1].split(",")[0].strip("(")) > 0.3
