"""Campaigns on clusters: equal rows with every engine, and workers that have only the files they were sent."""

import csv
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

import pytest

from hil.cases.campaign import engines
from hil.cases.campaign import files as campaign_files
from hil.cases.campaign.engines import Task, _run_unpacked
from hil.cases.campaign.files import Bundle, collect, unpack
from hil.cases.campaign.runs import run_one
from hil.common.errors import ConfigError, NetworkError
from hil.common.schema import preset_folder
from tests.support.processes import ROOT, Program, children_of, free_port, wait_for, write_scenario

ENGINES = ("dask", "ray")
NO_CLUSTER = {"DASK_SCHEDULER_ADDRESS": "", "RAY_ADDRESS": ""}
NOWHERE = dict.fromkeys(NO_CLUSTER, "127.0.0.1:1")
START_S = 240.0  # for engines to start, run and end, whatever else the machine does

PLANNER = """
from {helper} import SPEED

from hil.autonomy.control.controller import VelocityCommand
from hil.master.planner import Done, Planner


class Ahead(Planner):
    subscriptions = ()

    def __init__(self, seconds):
        self.seconds = seconds

    def begin(self, request):
        self.path = ()

    def command(self, time, samples):
        return Done("far enough") if time > self.seconds else VelocityCommand(surge=SPEED, depth=2.0)
"""


def write_own(folder: Path, module: str, speed: float = 0.3, absolute: bool = False) -> Path:
    """Return a scenario whose vehicle, world, seabed and planner are the user's own; its file."""
    (folder / "water").mkdir(parents=True)
    (folder / "code").mkdir()
    shutil.copy(f"{preset_folder('sim/vehicles')}/paper_six.toml", folder / "mine.toml")
    world = Path(preset_folder("sim/worlds"), "pool.toml").read_text()
    seabed = folder / "water" / "bed.f32"
    seabed.write_bytes(b"\0\0\x80\x40" * 4)  # 4 m
    stored = f'file = "{seabed if absolute else seabed.name}"'
    grid = "north_min = 0\neast_min = 0\nresolution = 12\nrows = 2\ncolumns = 2"
    (folder / "water" / "pond.toml").write_text(f"{world}\n[terrain]\n{stored}\n{grid}\n")
    (folder / "code" / f"{module}.py").write_text(PLANNER.format(helper=f"{module}_helper"))
    (folder / "code" / f"{module}_helper.py").write_text(f"SPEED = {speed}\n")
    path, _ = write_scenario(folder)
    text = path.read_text().replace('"paper_six"', f'"{folder / "mine.toml" if absolute else "mine.toml"}"')
    planner = f'[planner]\nclass = "{module}:Ahead"\nseconds = 3.0\n'
    path.write_text(text.replace('"pool"', '"water/pond.toml"') + planner)
    return path


@pytest.fixture
def plain_imports(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Remove the modules and paths that workers and users add to this process."""
    before = set(sys.modules)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield
    campaign_files._Cache.clear()
    for name in set(sys.modules) - before:
        if name.startswith("campaign_own"):
            del sys.modules[name]


@contextmanager
def importing(folder: Path) -> Iterator[None]:
    """Provide the user's machine: the planner's folder is on its path."""
    sys.path.insert(0, str(folder / "code"))
    yield
    sys.path.remove(str(folder / "code"))
    for name in [name for name in sys.modules if name.startswith("campaign_own")]:
        del sys.modules[name]


def sent(folder: Path, scenario: Path) -> tuple[Bundle, dict[str, object]]:
    """Return the bundle that is sent to a worker, and the result of a run in the original folder."""
    with importing(folder):
        bundle = collect(str(scenario), [{}, {"master.speed": 0.5}])
        row = run_one(str(scenario), {}, 3)
    return bundle, row


@pytest.mark.usefixtures("plain_imports")
@pytest.mark.parametrize("absolute", [False, True])
def test_a_worker_without_the_user_s_files_gives_the_same_result(absolute: bool, tmp_path: Path) -> None:
    """The user's folder is removed, as it does not exist on another machine."""
    folder = tmp_path / "user"
    scenario = write_own(folder, f"campaign_own_{absolute:d}", absolute=absolute)
    bundle, row = sent(folder, scenario)
    assert row["travelled"]
    assert row["reason"] == "far enough"
    # Other tests in this process may have loaded modules of other folders, which are sent along.
    names = {Path(path).relative_to(folder).as_posix() for path in bundle.files if Path(path).is_relative_to(folder)}
    module = f"code/campaign_own_{absolute:d}"
    own = {"short.toml", "mine.toml", "water/pond.toml", "water/bed.f32", f"{module}.py", f"{module}_helper.py"}
    assert names == own, "and nothing that is installed"
    shutil.rmtree(folder)
    assert repr(_run_unpacked(run_one, bundle, Task(7, {}, 3))) == repr((7, row))


@pytest.mark.usefixtures("plain_imports")
def test_errors_of_a_worker_name_the_user_s_files(tmp_path: Path) -> None:
    folder = tmp_path / "user"
    scenario = write_own(folder, "campaign_own_wrong")
    bundle, _ = sent(folder, scenario)
    with importing(folder):
        here = run_one(str(scenario), {"vehicle": "gone.toml"}, 1)
    _, there = _run_unpacked(run_one, bundle, Task(0, {"vehicle": "gone.toml"}, 1))
    assert there["reason"] == f"--set or --vary vehicle: {folder}/gone.toml: no such file"
    assert repr(there) == repr(here)


@pytest.mark.usefixtures("plain_imports")
def test_relative_names_start_from_the_folder_of_the_campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """This holds for names in the scenario and in its changes; a worker runs in another folder."""
    folder = tmp_path / "user"
    write_own(folder, "campaign_own_relative")
    shutil.move(folder / "mine.toml", folder / "six.toml")  # only the change names it
    changes = {"vehicle": "six.toml"}
    monkeypatch.chdir(folder)
    with importing(folder):
        bundle = collect("short.toml", [changes])
        local_result = run_one("short.toml", changes, 3)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    shutil.rmtree(folder)
    _, there = _run_unpacked(run_one, bundle, Task(0, changes, 3))
    assert local_result["reason"] == "far enough"
    assert repr(there) == repr(local_result)


@pytest.mark.usefixtures("plain_imports")
def test_the_next_campaign_on_the_same_workers_uses_its_own_files(tmp_path: Path) -> None:
    """A module of the same name that was imported before is not used in its place."""
    rows = []
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as worker:
        for number, speed in enumerate((0.3, 0.5, 0.3)):
            folder = tmp_path / str(number)
            bundle, row = sent(folder, write_own(folder, "campaign_own_again", speed))
            shutil.rmtree(folder)
            there = worker.submit(_run_unpacked, run_one, bundle, Task(0, {}, 3)).result()
            assert repr(there) == repr((0, row)), "to the last digit"
            rows.append(row["travelled"])
    assert rows[0] == rows[2] != rows[1]


def test_installed_files_are_not_sent(tmp_path: Path) -> None:
    bundle = collect("paper_field", [{}])
    assert not bundle.files
    root = Path(unpack(bundle).root)
    assert root.is_dir()
    campaign_files._Cache.clear()
    assert not root.exists(), "nothing is left"


def test_a_worker_of_another_version_is_refused() -> None:
    bundle = collect("paper_field", [{}])._replace(version="0.0.1")
    with pytest.raises(ConfigError, match=r"campaign was started by 0\.0\.1: install the same version"):
        unpack(bundle)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("address", "code", "expected_text"), [("127.0.0.1:PORT", 4, "refused"), ("here", 2, "HOST:PORT")]
)
def test_a_missing_scheduler_is_reported(
    engine: str, address: str, code: int, expected_text: str, tmp_path: Path
) -> None:
    variable = {"dask": "DASK_SCHEDULER_ADDRESS", "ray": "RAY_ADDRESS"}[engine]
    there = address.replace("PORT", str(free_port()))
    program = Program(tmp_path, "campaign", "paper_field", "--backend", engine, environment={variable: there})
    with program:
        assert program.wait(60) == code, program.output
    (line,) = program.output.splitlines()
    assert line.startswith("uuv-hil campaign: ")
    assert expected_text in line
    assert f"{variable}=" in line


def test_a_refusal_by_ray_is_reported_with_its_token(monkeypatch: pytest.MonkeyPatch) -> None:
    @contextmanager
    def refused() -> Iterator[None]:
        raise ConnectionError("Failed to connect to Ray cluster")
        yield

    monkeypatch.setattr(engines, "_ray", refused)
    bundle = collect("paper_field", [{}])
    monkeypatch.delenv("RAY_AUTH_MODE", raising=False)
    with pytest.raises(NetworkError, match=r"Failed to connect .*RAY_AUTH_MODE=token"):
        list(engines.run_on_cluster(run_one, bundle, [], 1, "ray"))
    monkeypatch.setenv("RAY_AUTH_MODE", "token")
    with pytest.raises(NetworkError, match="its log says more; every worker needs the same version"):
        list(engines.run_on_cluster(run_one, bundle, [], 1, "ray"))


@pytest.mark.parametrize("engine", ENGINES)
def test_a_missing_cluster_package_names_the_extra(engine: str, tmp_path: Path) -> None:
    package = {"dask": "distributed", "ray": "ray"}[engine]
    (tmp_path / f"{package}.py").write_text(f"raise ModuleNotFoundError('no {package}', name={package!r})\n")
    arguments = ("campaign", "paper_field", "--seeds", "1", "--backend", engine)
    with Program(tmp_path, *arguments, environment={**NOWHERE, "PYTHONPATH": str(tmp_path)}) as program:
        assert program.wait(60) == 5, program.output
    assert "pip install 'uuv-hil[cluster]'" in program.output


def campaign(folder: Path, scenario: Path, engine: str, environment: dict[str, str]) -> list[dict[str, str]]:
    """Return the rows of two parameter sets with two seeds, by two workers."""
    output = folder / f"{engine}.csv"
    arguments = [scenario, "--seeds", "2", "--vary", "master.speed=0.4,0.8", "--jobs", "2", "--backend", engine]
    code = {"PYTHONPATH": os.pathsep.join([str(scenario.parent / "code"), str(ROOT)])}
    with Program(folder, "campaign", *arguments, "-o", output, environment={**environment, **code}) as program:
        program.wait(START_S)
    assert "Traceback" not in program.output, program.output
    assert output.exists(), program.output
    with output.open() as file:
        return list(csv.DictReader(file))


@pytest.fixture
def requires_marker(request: pytest.FixtureRequest) -> None:
    if "cluster" not in str(request.config.option.markexpr):
        pytest.skip("starts clusters, for a minute: pytest -m cluster")


@pytest.mark.parametrize("engine", ENGINES)
def test_without_a_cluster_no_port_is_opened_and_no_module_of_the_current_folder_runs(
    engine: str, tmp_path: Path
) -> None:
    for name in ("select", "socket", "hil", "numpy", "distributed", "ray", "joblib"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'a').write({name!r})\n")
    arguments = ("campaign", "paper_field", "--seeds", "40", "--jobs", "2", "--vary", "master.time_limit=2")
    command = [sys.executable, "-P", "-m", "hil.cli"] if sys.version_info >= (3, 11) else None
    with Program(
        tmp_path, *arguments, "--backend", engine, environment=NO_CLUSTER, command=command, cwd=tmp_path
    ) as run:
        assert wait_for(lambda: "/40 runs" in run.output, 60), run.output
        family = [run.process.pid, *children_of(run.process.pid, recursive=True)]
        listening = subprocess.run(["ss", "-ltnpH"], capture_output=True, text=True, check=True).stdout
        assert not [line for line in listening.splitlines() if any(f"pid={pid}," in line for pid in family)]
        assert run.wait(60) == 6, run.output
    assert "names no cluster" in run.output
    assert not (tmp_path / "ran").exists(), (tmp_path / "ran").read_text()


@contextmanager
def dask_cluster(folder: Path) -> Iterator[str]:
    """Provide the address of a scheduler with two workers of one thread each, without files of the user."""
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    roles = [["scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]]
    roles += [["worker", address, "--nthreads", "1", "--no-dashboard", "--local-directory", str(folder)]] * 2
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    running = []
    with (folder / "cluster.log").open("w") as log:
        for role, *options in roles:
            command = [sys.executable, "-m", "dask", role, *options]
            running.append(subprocess.Popen(command, cwd=folder, env=environment, stdout=log, stderr=log))
    try:
        seen = wait_for(lambda: (folder / "cluster.log").read_text().count("Registered to:") == 2, 120)
        assert seen, (folder / "cluster.log").read_text()
        yield address
    finally:
        for process in reversed(running):
            process.send_signal(signal.SIGTERM)
        for process in running:
            process.wait(30)


@pytest.mark.cluster
@pytest.mark.usefixtures("requires_marker")
@pytest.mark.timeout(3 * START_S)
def test_an_existing_cluster_of_dask_is_used(tmp_path: Path) -> None:
    scenario = write_own(tmp_path / "user", "campaign_own_elsewhere")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    with dask_cluster(elsewhere) as address:
        rows = campaign(tmp_path, scenario, "dask", {"DASK_SCHEDULER_ADDRESS": address})
    assert rows == campaign(tmp_path, scenario, "loky", NO_CLUSTER)
