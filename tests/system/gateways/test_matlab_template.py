"""The template for MATLAB and Octave: its algorithms compared with Python, and its two cases with real vehicles."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from math import dist, inf, pi
from pathlib import Path
from random import Random
from typing import Any

import pytest

import hil
from hil.autonomy.paths.astar import path_length, plan
from hil.autonomy.paths.occupancy import OccupancyGrid
from hil.autonomy.paths.pursuit import PurePursuit
from hil.autonomy.paths.vfh import Scan, Vfh, VfhSettings
from hil.client.fleet import Fleet
from hil.common.errors import MissionError
from hil.gateways.json_lines.server import JsonGateway
from tests.support.clients.json_client import own_state
from tests.support.documents import blocks
from tests.support.octave import MATLAB, needs_octave, run, run_octave
from tests.support.processes import ROOT, Program, free_port

__all__ = ["own_state"]  # the fixture

np = pytest.importorskip("numpy", reason="maps are arrays")
pytestmark = [needs_octave, pytest.mark.timeout(900)]

READ = "cases = jsondecode(fileread('cases.json'));\nif ~iscell(cases), cases = num2cell(cases); end\n"
PRESETS = ROOT / "hil" / "scenario" / "presets"


def answers(folder: Path, cases: list[dict[str, Any]], body: str) -> list[Any]:
    """Return the result of Octave for each case, as JSON; `body` computes `answer` from `c`."""
    (folder / "cases.json").write_text(json.dumps(cases))
    script = f"{READ}for k = 1:numel(cases)\n  c = cases{{k}};\n{body}\n  disp(jsonencode(answer));\nend\n"
    return [json.loads(line) for line in run_octave(folder, script).splitlines()]


def test_the_global_planner_finds_a_shortest_path(tmp_path: Path) -> None:
    random, grids, cases = Random(5), [], []
    start, goal = (0.75, 0.75), (9.25, 14.25)
    for _ in range(8):
        cells = np.array([[random.random() < 0.22 for _ in range(30)] for _ in range(20)])
        cells[1, 1] = cells[18, 28] = False
        grids.append(OccupancyGrid(cells, 0.5, (0.0, 0.0)))
        cases.append({"blocked": cells.astype(int).tolist(), "start": start, "goal": goal})
    body = """  map = struct('blocked', c.blocked ~= 0, 'south', 0, 'west', 0, 'resolution', 0.5);
  try
    answer = global_planner(map, c.start.', c.goal.');
  catch problem
    answer = problem.message;
  end"""
    path_count = 0
    for grid, path in zip(grids, answers(tmp_path, cases, body), strict=True):
        try:
            shortest = path_length(plan(grid, start, goal))
        except MissionError:
            assert "obstacles part them" in path
            continue
        path_count += 1
        assert (path[0], path[-1]) == (list(start), list(goal))
        assert dist(start, goal) <= path_length(path) <= shortest + 1e-6
        for a, b in pairwise(path):
            points = [(a[0] + k / 200 * (b[0] - a[0]), a[1] + k / 200 * (b[1] - a[1])) for k in range(201)]
            near = [p for p in points if all(abs(x / 0.5 - round(x / 0.5)) > 0.05 for x in p)]  # not on a cell's edge
            assert all(map(grid.is_free, near))
    assert path_count >= 3


def test_the_local_planner_chooses_the_same_heading_as_python(tmp_path: Path) -> None:
    random, cases, expected = Random(7), [], []
    settings = VfhSettings(radius=0.3, safety=0.3, range=6.0, block_within=2.0, free_beyond=2.6)
    for _ in range(60):
        ranges = [random.uniform(0.5, 8.0) if random.random() < 0.15 else inf for _ in range(181)]
        heading, target = random.uniform(-pi, pi), random.uniform(-pi, pi)
        scan = Scan(-2.35, 4.7 / 180, ranges)
        expected.append(Vfh(settings).steer(scan, heading, target))
        angles = {"angle_min": scan.first, "angle_increment": scan.step}
        cases.append({"ranges": [r if r < inf else None for r in ranges], "heading": heading, "aim": target, **angles})
    body = """  command = struct('surge', 0.8, 'yaw_rate', 0, 'aim', c.aim);
  c.ranges = uuv.Vehicle.numbers(c.ranges);
  [command, state] = local_planner([], command, c, c.heading, inf, template_options());
  answer = struct('heading', state.last, 'surge', command.surge, 'turn', command.yaw_rate);"""
    assert sum(value is None for value in expected) < 30 < sum(value is not None for value in expected)
    for ours, theirs in zip(expected, answers(tmp_path, cases, body), strict=True):
        assert 0.0 <= theirs["surge"] <= 0.8
        assert abs(theirs["turn"]) <= 0.5
        if ours is None:
            assert (theirs["heading"], theirs["surge"]) == (None, 0.0)
        else:
            assert abs((theirs["heading"] - ours + pi) % (2.0 * pi) - pi) < 1e-6


def test_pure_pursuit_gives_the_same_commands_as_python(tmp_path: Path) -> None:
    random, cases, expected = Random(9), [], []
    path = [[0.0, 0.0], [4.0, 3.0], [9.0, 3.0], [12.0, -2.0]]
    for _ in range(40):
        position = [random.uniform(-1.0, 2.0), random.uniform(-1.0, 2.0)]
        heading = random.uniform(-pi, pi)
        pursuit = PurePursuit([(n, e) for n, e in path], 2.0, 0.8, tolerance=0.6)
        command = pursuit.update(position, heading)
        expected.append((command.surge, command.yaw_rate, pursuit.aim))
        cases.append({"here": position, "heading": heading})
    body = f"""  path = reshape({[x for point in path for x in point]}, 2, []).';
  [command, along] = pure_pursuit(path, 0, c.here, c.heading, template_options());
  answer = [command.surge command.yaw_rate command.aim];"""
    for ours, theirs in zip(expected, answers(tmp_path, cases, body), strict=True):
        assert theirs == pytest.approx(ours, abs=1e-6)


def test_the_scheduler_respects_the_required_order_of_tasks(tmp_path: Path) -> None:
    script = """
state = [];
time = 0;
place = [0 0];
while isempty(state) || ~state.done
  [goal, state] = task_scheduler(state, paper_tasks(), time, place, template_options());
  if ~isempty(goal), place = goal; end
  time = time + 1;
end
printf('%s %d\\n', strjoin(state.finished), time);
try
  task_scheduler([], struct('name', 'a', 'at', [1 1], 'duration', 0, 'needs', 'b'), 0, [0 0], template_options());
catch problem
  disp(problem.message);
end
"""
    order, problem = run_octave(tmp_path, script).splitlines()
    assert order == "charging acquisition transmission home 50"  # 45 s of work, and a step to each place
    assert problem == "no task can begin any more; these wait for others: a"


@contextmanager
def serve(folder: Path, preset: str) -> Iterator[tuple[Fleet, JsonGateway]]:
    """Provide a slave of a preset, and a gateway to it."""
    port = free_port()
    scenario = folder / "scenario.toml"
    scenario.write_text((PRESETS / preset).read_text() + f'[slave]\nlisten = "tcp/127.0.0.1:{port}"\n')
    with Program(folder, "slave", scenario) as slave:
        slave.expect("ready")
        with hil.connect(f"tcp/127.0.0.1:{port}") as fleet, JsonGateway(fleet, "127.0.0.1", 0) as gateway:
            yield fleet, gateway


RESULT = """
result = run_template(vehicle{tasks});
track = result.track(1:20:end, 2:3);
disp(jsonencode(struct('visited', {{result.visited}}, 'track', track, 'paths', {{result.paths}})));
"""
GOAL = ", struct('name', 'goal', 'at', [50 50], 'duration', 0, 'needs', '')"


def fly(folder: Path, preset: str, tasks: str) -> dict[str, Any]:
    """Fly a case in Octave; assert that nothing was touched."""
    with serve(folder, preset) as (fleet, gateway):
        (line,) = run(folder, gateway, RESULT.format(tasks=tasks), seconds=800.0)
        assert fleet["uuv1"].diagnostics.contacts == 0
        result: dict[str, Any] = json.loads(line)
    return result


def test_path_planning_in_octave_reaches_the_goal(tmp_path: Path) -> None:
    result = fly(tmp_path, "path_planning.toml", GOAL)
    assert result["visited"] == ["goal"]
    assert dist(result["track"][-1], (50.0, 50.0)) < 2.0


NEARER = """, struct( ...
  'name', {'transmission', 'acquisition', 'charging', 'home'}, ...
  'at', {[6 15], [18 5], [5 5], [0 0]}, ...
  'duration', {2, 3, 4, 0}, ...
  'needs', {'acquisition', 'charging', '', 'transmission'})"""


def test_task_scheduling_in_octave_visits_all_stations(tmp_path: Path) -> None:
    """The stations are those of the preset, but nearer and with shorter tasks."""
    result = fly(tmp_path, "task_scheduling.toml", NEARER)
    assert result["visited"] == ["charging", "acquisition", "transmission", "home"]
    assert len(result["paths"]) == 4
    for station in ((5.0, 5.0), (18.0, 5.0), (6.0, 15.0)):
        assert min(dist(place, station) for place in result["track"]) < 1.0
    assert dist(result["track"][-1], (0.0, 0.0)) < 1.5


REPLACED = """function [command, state] = local_planner(state, command, scan, heading, reach, options)
  command.surge = 0;
  command.yaw_rate = 0.25;
end
"""
TURNING = """
options = template_options();
options.time_limit = 4;
try
  run_template(vehicle, [], options);
catch problem
  printf('%s\\n%.2f\\n', problem.message, vehicle.state().nu(6));
end
"""


def test_a_function_in_the_user_s_folder_replaces_that_of_the_template(tmp_path: Path) -> None:
    (tmp_path / "local_planner.m").write_text(REPLACED)
    with serve(tmp_path, "path_planning.toml") as (_, gateway):
        problem, turn = run(tmp_path, gateway, TURNING)
    assert problem == "the tasks are not done within 4 s; visited: "
    assert float(turn) == pytest.approx(0.25, abs=0.15)


def test_the_program_of_the_tutorial_runs_in_octave(tmp_path: Path) -> None:
    page = ROOT / "docs" / "tutorials" / "matlab.md"
    text = "".join(block.text for block in blocks("matlab", page=page))
    text = text.replace("vehicle = uuv.Vehicle('uuv1');\n", "").replace("[~, folder] = system(", "folder = disabled(")
    assert text.count("uuv.Vehicle") == 0
    with serve(tmp_path, "task_scheduling.toml") as (fleet, gateway):
        text = f"disabled = @(command) '{MATLAB}';\n{text}disp(jsonencode(result.visited));\n"
        lines = run(tmp_path, gateway, text, seconds=400.0)
        assert fleet["uuv1"].diagnostics.contacts == 0
    assert lines[-1] == '["first","second"]'


LOOP = """
clock = tic;
rate = uuv.Rate(20);
spent = cputime();
punctual = 0;
for k = 1:100
  state = vehicle.state();
  scan = vehicle.laser();
  vehicle.drive('surge', 0.1, 'depth', 5);
  if k == 50, pause(0.2); end
  rate.wait();
  punctual = punctual + (toc(clock) - rate.cycles * rate.period <= 0.1 * rate.period);
end
printf('%g\\n', rate.cycles, rate.late, punctual, toc(clock), (cputime() - spent) / 100);
"""


def test_a_loop_of_20_hz_takes_less_than_its_period(tmp_path: Path) -> None:
    """A cycle takes less processor time than its period, and exactly the cycles that began late are counted.

    The number of late cycles depends on other load of the machine: docs/how-to/matlab.md has it for ten minutes.
    """
    with serve(tmp_path, "path_planning.toml") as (_, gateway):
        before_s = time.process_time()
        cycles, late, punctual, took_s, cycle_s = map(float, run(tmp_path, gateway, LOOP))
        gateway_s = (time.process_time() - before_s) / 100
    assert cycles >= 103, "a pause of four periods leaves out three"
    assert 0.05 * cycles <= took_s
    assert 3 <= late <= cycles - punctual, "on a busy machine all may be"
    assert cycle_s + gateway_s < 0.05
