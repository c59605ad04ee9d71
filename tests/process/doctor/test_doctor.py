"""`uuv-hil doctor`: it reports the software and settings of a machine, and changes nothing."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest

from boards.tree import Tree
from hil.commands import doctor
from hil.doctor import software as doctor_software
from hil.doctor.findings import Case, User
from hil.ros.topics import TOPICS
from hil.scenario.config import load_scenario
from tests.support.processes import write_scenario

ROOT = Path(__file__).parents[3]


def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "hil.cli", "doctor", *arguments],
        cwd=ROOT, capture_output=True, text=True, env=os.environ | environment,
    )  # fmt: skip


def case_here(scenario: str | None = None) -> Case:
    return Case(Tree("/"), None, load_scenario(scenario) if scenario else None, doctor.find_user(Tree("/"), None))


def test_every_finding_without_a_scenario() -> None:
    done = run("--json", UUV_HIL_NATIVE="0")
    assert (done.returncode, done.stderr) == (0, "")
    rows = {row["topic"]: row for row in json.loads(done.stdout)}
    assert rows["Python"]["text"].startswith(".".join(map(str, sys.version_info[:3])))
    assert rows["zenoh"]["text"] == metadata.version("eclipse-zenoh")
    assert rows["pyserial"]["text"] == metadata.version("pyserial")
    assert rows["step"]["text"] == "Python, as UUV_HIL_NATIVE=0 says"
    assert (rows["step"]["level"], rows["step"]["remedy"]) == ("note", "unset UUV_HIL_NATIVE")
    assert rows["board"]["text"]
    assert "SCHED_FIFO" in rows["scheduling"]["text"]
    assert "locked" in rows["memory"]["text"]
    assert rows["clock"]["text"]
    assert {row["level"] for row in rows.values()} <= {"ok", "note"}


def test_an_invalid_setting_is_a_problem() -> None:
    completed = run("paper_field", UUV_HIL_NATIVE="maybe")
    assert completed.returncode == 1
    assert "problem  step" in completed.stdout
    assert "UUV_HIL_NATIVE='maybe'" in completed.stdout
    assert "-> unset UUV_HIL_NATIVE" in completed.stdout
    assert run(UUV_HIL_NATIVE="maybe").returncode == 0  # nothing is needed yet


def test_the_settings_of_this_process_do_not_change() -> None:
    def settings() -> tuple[int, list[str]]:
        status = Path("/proc/self/status").read_text().splitlines()
        return os.sched_getscheduler(0), [line for line in status if line.startswith("VmLck")]

    before = settings()
    assert "memory" in {finding.topic for finding in doctor.findings(case_here())}
    assert settings() == before


def test_a_missing_package_is_a_problem_only_if_the_scenario_needs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(doctor_software.REQUIRED_BY_VALUE, "python", ("tea", "no-such-distribution", "tea", "tea"))
    assert "tea" not in {finding.topic for finding in doctor_software.check_packages(case_here())}
    found = {finding.topic: finding for finding in doctor_software.check_packages(case_here("paper_field"))}
    assert found["tea"].level == "problem"


def test_a_step_that_takes_more_than_its_share_is_a_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load_scenario("paper_field")
    measured = doctor_software.measure_step_s(scenario)
    assert 0.0 < measured < 0.1
    monkeypatch.setattr(doctor_software, "measure_step_s", lambda _: 0.001)
    assert doctor_software.check_step_cost(scenario, 0.5).level == "ok"
    found = doctor_software.check_step_cost(scenario, 0.3)
    assert found.level == "problem"
    assert found.text == "1000 µs of every 2500 µs, 40.0% of a core; at most 30% is recommended"


@pytest.fixture
def topics() -> Iterator[None]:
    """Forget a scenario's own sensors after the test."""
    before = dict(TOPICS)
    yield
    TOPICS.clear()
    TOPICS.update(before)


NOWHERE = '[security]\nslave = "keys/a"\nmaster = "keys/b"\nmay_command = ["b"]'
RECORDING = "[recording]\nslave = true\nfolder = '"
FAILING_PLANNER = """
class Wild:
    def __init__(self):
        1 / 0
    def begin(self, request): pass
    def command(self, time, samples): pass

class Sour:
    message = "std_msgs/msg/Float64"
    def begin(self, scene, mounting, random): pass
    def sample(self, time_ns, state): raise OverflowError("too sour")
"""


@pytest.mark.parametrize(
    ("old", "new", "topic", "message"),
    [
        ("[slave]", f"{NOWHERE}\n[slave]", "slave", "keys/a/ca.pem is not there; `uuv-hil keys add a`"),
        ("goal = [8, 7]", "goal = [800, 7]", "planner", "the goal (800.00 m north, 7.00 m east) is outside the map"),
        ("depth = 2", "depth = 900", "slave", "an obstacle or the seabed of pool is there"),
        ("[slave]", '[planner]\nclass = "nope:Nope"\n[slave]', "planner", "nope cannot be imported"),
        ("[slave]", '[planner]\nclass = "wild:Wild"\n[slave]', "planner", "ZeroDivisionError: division by zero"),
        ("[slave]", f"{RECORDING}/dev/null/x'\n[slave]", "recording", "/dev/null is not a folder"),
        ("[slave]", f"{RECORDING}/proc/x'\n[slave]", "recording", "0 MiB free"),
        ("[link]", '[sensors.mine]\nclass = "wild:Sour"\nrate = 50\n[link]', "step", "OverflowError: too sour"),
    ],
)  # fmt: skip
def test_what_the_slave_or_the_planner_would_refuse_is_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, topics: None, old: str, new: str, topic: str, message: str
) -> None:
    """Each is one problem with what to do about it, and nothing is raised."""
    (tmp_path / "wild.py").write_text(FAILING_PLANNER)
    monkeypatch.syspath_prepend(str(tmp_path))
    path, _ = write_scenario(tmp_path)
    assert [
        finding.level for finding in doctor_software.check_packages(case_here(str(path))) if finding.topic == "start"
    ] == ["ok"]
    path.write_text(path.read_text().replace(old, new, 1))
    case = case_here(str(path))
    problems = [
        finding
        for finding in (*doctor_software.check_packages(case), *doctor_software.check_step(case))
        if finding.level == "problem"
    ]
    (finding,) = problems
    assert finding.topic == topic
    assert message in finding.text
    assert str(path) in finding.remedy or "uuv-hil keys" in finding.text or "correct the sensor" in finding.remedy


def test_a_start_without_a_planner_or_a_goal_is_no_problem() -> None:
    """A fleet has a planner for each, an external controller none, and a scenario without a goal is flown by hand."""
    scenario = load_scenario("paper_field", {"master.goal": [900.0, 0.0]})
    user = doctor.find_user(Tree("/"), None)
    lost_topics = [finding.topic for finding in doctor_software.check_start(scenario, user)]
    (away,) = doctor_software.check_start(load_scenario("paper_field", {"start.north": -500.0}), user)
    assert "the start (-500.00 m north, 0.00 m east) is outside the map" in away.text
    by_hand = scenario._replace(master=scenario.master._replace(goal=None))
    for other in (by_hand, scenario._replace(controller="external"), load_scenario("target_hunting")):
        assert [finding.level for finding in doctor_software.check_start(other, user)] == ["ok"]
    assert lost_topics == ["planner"]


def test_a_recording_folder_of_another_user_is_a_problem(tmp_path: Path) -> None:
    """The folder's mode decides; nothing is created."""
    folder = tmp_path / "closed"
    folder.mkdir(mode=0o755)
    outsider = User("outsider", 4711, (4711,))
    scenario = load_scenario("paper_field", {"recording.slave": True, "recording.folder": str(folder / "a" / "b")})
    (finding,) = doctor_software.check_start(scenario, outsider)
    assert (finding.level, finding.topic) == ("problem", "recording")
    assert f"no permission for outsider in {folder}" in finding.text
    folder.chmod(0o777)
    assert [finding.level for finding in doctor_software.check_start(scenario, outsider)] == ["ok"]
    assert list(folder.iterdir()) == []
