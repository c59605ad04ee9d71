"""`uuv-hil scenario`, `--set` of the other commands, their help and JSON output."""

import json
import re
from pathlib import Path

import pytest

from hil.cli import main
from hil.common.schema import preset_names
from hil.scenario.config import SCENARIOS, load_scenario


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = main(list(arguments))
    output = capsys.readouterr()
    return code, output.out, output.err


def test_the_installed_scenarios_are_listed_and_none_has_a_problem(capsys: pytest.CaptureFixture[str]) -> None:
    code, output, _ = run(capsys, "scenario", "list")
    assert code == 0
    assert "paper " not in output, "who reads the list knows of no paper"
    assert re.search(r"^target_hunting +4 x ", output, re.M)
    for name in preset_names(SCENARIOS):
        assert re.search(rf"^{name} ", output, re.M)
        assert run(capsys, "scenario", "check", name, "--json") == (0, "[]\n", "")


def test_a_copy_is_the_same_scenario_and_replaces_no_file(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    assert run(capsys, "scenario", "new", str(path), "--copy", "task_scheduling")[0] == 0
    mine, theirs = load_scenario(str(path)), load_scenario("task_scheduling")
    assert mine._replace(path="", link=theirs.link) == theirs._replace(path="")
    assert "#" in path.read_text(), "with its comments"
    assert run(capsys, "scenario", "show", str(path))[1] == path.read_text()
    code, _, error = run(capsys, "scenario", "new", str(path))
    assert (code, "exists already" in error) == (2, True)
    assert run(capsys, "scenario", "new", str(tmp_path / "mine"))[0] == 2
    code, _, error = run(capsys, "scenario", "new", str(tmp_path / "b.toml"), "--copy", "nope")
    assert (code, "paper_field" in error) == (2, True)


@pytest.mark.parametrize(
    ("change", "level", "message"),
    [
        ("link.baud=1200", "problem", "use at least"),
        ("link.options.x=3", "problem", 'link: options: x: protocol = "frame" has none'),
        ('link={protocol="mavlink", options={sytem=3}}', "problem", "no key 'sytem'; did you mean 'system'?"),
        ("master.goal=[45, 45]", "problem", "inside an obstacle"),
        ("master.goal=[5000, 5000]", "problem", "outside the map"),
        ("start.depth=500", "problem", "cannot start at"),
        ("master.depth=500", "problem", "seabed"),
        ("master.speed=2.5", "warning", "reaches 2.21 m/s"),
        ("vehicle=bluerov2_li2020", "warning", "loses its attitude above 0.7 m/s"),
    ],
)
def test_problems_of_the_link_are_found(
    capsys: pytest.CaptureFixture[str], change: str, level: str, message: str
) -> None:
    code, output, _ = run(
        capsys, "scenario", "check", "paper_field", "--set", "link.port=/dev/ttyUSB0", "--set", change
    )
    assert code == (1 if level == "problem" else 0)
    assert output.startswith(f"{level}: ")
    assert message in output


HORIZONTAL = ("front_right", "front_left", "rear_right", "rear_left")
OFF = "{{thruster='{}', kind='off'}}"
SECURITY = "security={slave='no/slave', master='no/master', may_command=['master']}"


@pytest.mark.parametrize(
    ("changes", "level", "message"),
    [
        (["master.goal=[99, 0]"], "problem", "master: goal: the goal (99.00 m north, 0.00 m east) is outside the map"),
        (["master.margin=20"], "problem", "start: the start (0.00 m north"),
        (["master.time_limit=20"], "problem", "master: time_limit: the path of 74 m takes at least 93 s at 0.80 m/s"),
        (["slave.deadman=0.1", "master.command_period=0.2"], "problem", "slave: deadman: 0.1 s, but commands are"),
        (["slave.deadman=0.3", "master.command_period=0.2"], "warning", "go to neutral after a lost command"),
        (["network.command_rate=10"], "warning", "network: command_rate: the slave accepts 10 commands a second"),
        (["slave.control_period=0.001"], "warning", "slave: control_period: 0.001 s is shorter than step"),
        (["slave.step=0.02"], "problem", "sensor 'imu': its rate is above 50 Hz"),
        (["failure=[{thruster='t', kind='off'}]"], "problem", "failure: no thruster 't'; there are: front_right"),
        (["failure=[{thruster='rear_left', kind='off', time=400.0}]"], "warning", "failure[0]: time: 400 s is after"),
        (["tether.length=3"], "problem", "tether: length: 3 m, but the anchor is 5.0 m away from start: use"),
        (["planner.class=hil.master.avoid:Avoid"], "problem", "planner: Avoid needs the topic 'laser'"),
        (["modem.slot=1"], "warning", "modem: has no effect: only a fleet"),
        (["mavlink.endpoints=['tcpin:127.0.0.1:7448']"], "problem", "listen uses ports 7447 and 7448"),
        (["mavlink.endpoints=['udpin:127.0.0.1:9', 'udpin:127.0.0.1:9']"], "problem", "is listed twice: remove one"),
        (["master.depth_margin=0"], "warning", "master: depth_margin: 0 m is less than the overshoot"),
        (["sensors.odometry.rate=1"], "warning", "sensors: odometry: rate: 1 Hz is too slow for the controller"),
        ([f"failure=[{', '.join(map(OFF.format, HORIZONTAL))}]"], "problem", "all horizontal thrusters fail at 0 s"),
        ([SECURITY], "problem", "security: slave: there is no folder"),
    ],
)
def test_inconsistent_settings_are_found(
    capsys: pytest.CaptureFixture[str], changes: list[str], level: str, message: str
) -> None:
    assert_found(capsys, "paper_field", changes, level, message)


@pytest.mark.parametrize(
    "changes",
    [
        ["master.depth_margin=0", "master.allow=['too_deep']"],
        ["sensors.odometry.rate=2"],
        [f"failure=[{', '.join(map(OFF.format, HORIZONTAL[1:]))}]"],
        [f"failure=[{', '.join(map(OFF.format, HORIZONTAL))}, {{thruster='rear_left', kind='repaired', time=5.0}}]"],
    ],
)
def test_acceptable_settings_give_no_finding(capsys: pytest.CaptureFixture[str], changes: list[str]) -> None:
    words = [word for change in changes for word in ("--set", change)]
    assert run(capsys, "scenario", "check", "paper_field", *words) == (0, "paper_field: no problem found\n", "")


def assert_found(capsys: pytest.CaptureFixture[str], name: str, changes: list[str], level: str, message: str) -> None:
    """Assert that `check` finds one thing, or it first, and that each line names the file."""
    code, output, error = run(capsys, "scenario", "check", name, *[w for change in changes for w in ("--set", change)])
    assert (code, error) == (1 if level == "problem" else 0, "")
    assert message in output.splitlines()[0]
    assert all(f": {load_scenario(name).path}: " in line for line in output.splitlines())
    assert output.startswith(level)


@pytest.mark.parametrize(
    ("tasks", "message"),
    [
        ("{name='a', at=[6.5, 7.5], duration=1.0}", "planner: the place (6.5 m north, 7.5 m east) is inside an obst"),
        ("{name='a', at=[650.0, 7.5], duration=1.0}", "planner: the place (650 m north, 7.5 m east) is outside"),
        ("{name='a', at=[5.0, 5.0], duration=601.0}", "master: time_limit: the tasks take 601 s"),
        ("{name='a', at=[5.0, 5.0], duration=1.0, needs=['b']}", "the task 'a' needs 'b', which is not another task"),
    ],
)
def test_impossible_tasks_are_found(capsys: pytest.CaptureFixture[str], tasks: str, message: str) -> None:
    assert_found(capsys, "task_scheduling", [f"planner.task=[{tasks}]"], "problem", message)


def members(*member_positions: tuple[float, int]) -> str:
    """Return the change that makes these the members: how far north, and the port of their slaves."""
    rows = [
        f"{{node='m{number}', listen='tcp/127.0.0.1:{port}', agent='tcp/127.0.0.1:{port + 100}', "
        f"north={north}, east=0.0}}"
        for number, (north, port) in enumerate(member_positions)
    ]
    return f"member=[{', '.join(rows)}]"


@pytest.mark.parametrize(
    ("changes", "level", "message"),
    [
        ([members((0.0, 7000), (0.3, 7002), (3.0, 7004))], "problem", "member[1]: m1 starts 0.30 m from m0"),
        ([members((0.0, 7000), (2.0, 7001), (4.0, 7004))], "problem", "member[1]: listen: tcp/127.0.0.1:7001 uses"),
        ([members((0.0, 7000), (2.0, 7002))], "problem", "hunting: 2 vehicles cannot surround a target"),
        (["hunting.ring=0.2"], "problem", "hunting: ring: neighbours on it are 0.28 m apart, less than min_separation"),
        (["hunting.ring=3.7"], "warning", "more than communication_range"),
        (["master.time_limit=10"], "problem", "master: time_limit: the hunt takes"),
        (["hunting.target=[5.0, 40.0]", "master.time_limit=600"], "problem", "outside the map of paper_hunt"),
        (["world=paper_field"], "problem", "hunting: the path of uuv3 passes"),
        (["modem.slot=0.1"], "problem", "modem: slot: a report of 16 bytes takes 0.23 s, more than a slot"),
        (["modem.longest=8"], "problem", "modem: longest: 8 bytes is shorter than a report: use 16"),
        (["modem.slot=0", "hunting.report_timeout=9"], "warning", "hunting: report_period: 0.1 s, but the reports of"),
    ],
)
def test_problems_of_a_fleet_are_found(
    capsys: pytest.CaptureFixture[str], changes: list[str], level: str, message: str
) -> None:
    name = "target_hunting_acoustic" if "modem" in changes[0] else "target_hunting"
    assert_found(capsys, name, changes, level, message)


def test_a_scenario_is_changed_for_one_flight(capsys: pytest.CaptureFixture[str]) -> None:
    """Every command that flies has the same option."""
    code, _, error = run(capsys, "sim", "paper_field", "--fast", "--set", "master.goal=[45, 45]")
    assert (code, "inside an obstacle" in error) == (6, True)
    code, output, _ = run(capsys, "sim", "paper_field", "--fast", "--set", "master.goal=[3, 0]")
    assert (code, "goal reached" in output) == (0, True)
    for command in ("demo", "master", "slave", "fleet agent", "doctor"):
        code, _, error = run(capsys, *command.split(), "paper_field", "--set", "master.sped=1")
        assert (code, "did you mean 'speed'" in error) == (2, True), command


def test_sim_and_campaign_print_json(capsys: pytest.CaptureFixture[str]) -> None:
    goal = ("--set", "master.goal=[3, 0]")
    code, output, _ = run(capsys, "sim", "paper_field", "--fast", *goal, "--json")
    outcome = json.loads(output)
    assert (code, outcome["success"], outcome["reason"]) == (0, True, "goal reached")
    assert outcome["duration"] > outcome["took_s"]
    command = ("campaign", "paper_field", "--seeds", "2", "--vary", "master.goal=[3]", "--json")
    assert run(capsys, *command)[0] == 2
    code, output, _ = run(capsys, "campaign", "paper_field", "--seeds", "2", "--vary", "master.time_limit=1", "--json")
    rows = json.loads(output)
    assert code == 6
    assert [(row["seed"], row["success"], row["reason"]) for row in rows] == [
        (seed, False, "time limit") for seed in (1, 2)
    ]
