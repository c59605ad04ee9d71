"""Client, gateways and planners need nothing that only Linux has: Windows and macOS run them too.

A process without those modules and functions imports all of them, flies a simulation, and steers a slave.
"""

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcap.reader import make_reader

from hil.cli import COMMANDS
from hil.common.children import ROOT, worker_options
from tests.support.other_systems import WHOLLY, missing_names
from tests.support.processes import PATIENCE_S, Program, free_port, running_slave, write_scenario

BLOCK = (
    f"GONE, NAMES = {WHOLLY}, {missing_names()}\n"
    + """
import functools, importlib, mmap, os, pkgutil, select, selectors, signal, socket, ssl, shutil, sys, sysconfig, time
import zenoh, numpy, psutil, asyncio  # others' own affair
selectors.DefaultSelector = selectors.SelectSelector
usage = shutil.disk_usage("/")
shutil.disk_usage = lambda folder: usage  # Windows' needs no statvfs
socket.socketpair = functools.partial(socket.socketpair, socket.AF_UNIX)  # they have it, of another family
sysconfig.get_config_vars()  # while this still is Linux

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name in GONE:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Blocker())
for name in GONE:
    sys.modules.pop(name, None)
for module, names in NAMES.items():
    for name in names:
        vars(sys.modules[module]).pop(name, None)
"""
)
IMPORT = """
from itertools import chain
ONLY_LINUX = ("hil.slave.", "hil.bench.", "hil.doctor.", "hil.install.", "hil.autopilots.", "hil.links.wires.",
    "hil.commands.board.", "hil.commands.doctor", "hil.__main__")
import hil, sim
count = 0
for found in chain(pkgutil.walk_packages(hil.__path__, "hil."), pkgutil.walk_packages(sim.__path__, "sim.")):
    if not found.name.startswith(ONLY_LINUX):
        importlib.import_module(found.name)
        count += 1
print("imported", count)
"""
STEER = """
import hil
sys.platform = "darwin"
with hil.connect(sys.argv[1], wait=60.0) as fleet:
    (vehicle,) = fleet.wait_for("uuv1")
    vehicle.drive(0.3)
    print("imu", vehicle.imu)
"""


# What `uuv-hil` does, in a process without them.
COMMAND = [
    sys.executable,
    "-c",
    BLOCK + "sys.platform = 'darwin'\ndel os.environ['UUV_HIL_LIFELINE']  # nothing there starts us with one\n"
    "from hil.cli import main\nsys.exit(main(sys.argv[1:]))",
]


# Runs each command with --help. Prints those that only Linux has.
HELP = """
import contextlib, io
sys.platform = "win32"
from hil.cli import COMMANDS, main
for name in COMMANDS:
    output, wrong = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(wrong):
        try:
            code = main([*name.split(), "--help"])
        except SystemExit as end:
            code = end.code
    if code == 3:
        assert "runs on Linux" in wrong.getvalue(), (name, wrong.getvalue())
        print(name)
    else:
        assert code == 0 and "usage:" in output.getvalue(), (name, code, wrong.getvalue())
"""


def run(code: str, *arguments: str) -> str:
    command = [sys.executable, "-c", BLOCK + code, *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def slave(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with running_slave(tmp_path_factory.mktemp("slave")) as (_, endpoint):
        yield endpoint


def test_client_gateways_and_planners_import_no_linux_modules() -> None:
    assert int(run(IMPORT).split()[1]) > 450


def test_each_command_runs_or_reports_that_it_needs_linux() -> None:
    benches = [name for name in COMMANDS if name.startswith("bench ")]
    needing = {"demo", "slave", "link loopback", "stm32", "board", "doctor", *benches}
    assert set(run(HELP).splitlines()) == needing


def test_benchmarks_are_not_measured_without_linux(tmp_path: Path) -> None:
    with Program(tmp_path, "bench", "load", command=COMMAND) as program:
        assert program.wait() == 3, program.output
    assert "bench load runs on Linux only, and this is darwin" in program.output


def test_a_simulated_flight_with_its_plot_runs_without_linux_modules(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    words = ("sim", scenario, "--fast", "--plot", tmp_path / "flight.png", "--output", tmp_path / "flight.csv")
    with Program(tmp_path, *words, command=COMMAND) as program:
        assert program.wait() == 0, program.output
    assert (tmp_path / "flight.png").read_bytes().startswith(b"\x89PNG")


def test_a_recording_made_without_linux_modules_is_complete(slave: str, tmp_path: Path) -> None:
    words = ("recording", "make", "--connect", slave, "-o", tmp_path / "dive", "--seconds", "2")
    with Program(tmp_path, *words, command=COMMAND) as recorder:
        assert recorder.wait() == 0, recorder.output
    (file,) = (tmp_path / "dive").glob("*.mcap")
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count > 10


def test_workers_need_no_linux_features(monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker that does not find its parent in /proc ends itself. The real pool of joblib cannot run here."""
    monkeypatch.setattr(sys, "platform", "darwin")
    with worker_options() as options:
        assert options == {}


def test_a_client_without_linux_modules_commands_a_slave(slave: str) -> None:
    assert run(STEER, slave).startswith("imu ")


def test_the_json_gateway_runs_without_linux_modules(slave: str, tmp_path: Path) -> None:
    words = ("gateway", "json", "--connect", slave, "--listen", f"127.0.0.1:{free_port()}")
    with Program(tmp_path, *words, command=COMMAND) as gateway:
        place = gateway.expect(r"JSON at (\S+):(\d+)")
        gateway.expect("connected: uuv1")
        with socket.create_connection((place[1], int(place[2])), 10) as client, client.makefile() as lines:
            client.sendall(b'{"do": "vehicles"}\n')
            assert "uuv1" in lines.readline()
        assert gateway.stop(signal.SIGINT) in (0, 130), gateway.output


def test_the_mavlink_gateway_runs_without_linux_modules(slave: str, tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(PATIENCE_S)
        place = f"udpout:127.0.0.1:{station.getsockname()[1]}"
        with Program(tmp_path, "mavlink", "--connect", slave, "--endpoint", place, command=COMMAND) as gateway:
            try:
                packet = station.recv(300)
            except TimeoutError:
                pytest.fail(gateway.output)
            assert packet[0] == 0xFD  # of MAVLink 2
            assert gateway.stop(signal.SIGINT) in (0, 130), gateway.output


def test_a_planner_without_linux_modules_flies_a_mission(slave: str, tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    scenario.write_text(scenario.read_text().replace("goal = [8, 7]", "goal = [5.5, 5]"))
    words = ("master", scenario, "--connect", slave)
    with Program(tmp_path, *words, command=COMMAND) as master:
        assert master.wait() == 0, master.output


def test_modules_that_need_linux_fail_without_it() -> None:
    command = [sys.executable, "-c", BLOCK + "import hil.slave.drivers.pty_driver, hil.links.wires.terminal"]
    assert "No module named" in subprocess.run(command, cwd=ROOT, capture_output=True, text=True).stderr
