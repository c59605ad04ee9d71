"""The wheel on an emulated 64-bit Arm board: equal results, and a slave with its master outside the emulator."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.boards.emulated import built_board
from tests.support.documents import blocks
from tests.support.processes import ROOT, free_port, wait_for
from tools.virtual_board.board import VirtualBoard
from tools.virtual_board.commands import TO_BUILD, missing

pytestmark = [
    pytest.mark.aarch64,
    pytest.mark.timeout(1800),
    pytest.mark.skipif(bool(missing(TO_BUILD)), reason=missing(TO_BUILD)),
]

# Dynamics, thruster lags, errors and rays, each with its C twin; every sample counts.
FLIGHT_CODE = """
import hashlib, platform, sys
from sim.assembly import make_dynamics
from sim.sensors.sensor_set import read_sensors
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle
from sim.environment.world import load_world
vehicle, _ = load_vehicle("bluerov2_heavy")
sensors = read_sensors({"laser": {"rate": "10 Hz"}, "ahrs": {}, "scanning_sonar": {}, "echosounder": {}}, "here")
simulation = Simulation(vehicle, load_world("harbour"), sensors, seed=11, position=(20.0, 0.0, 4.0), heading=0.3)
digest = hashlib.sha256()
for step in range(2500):
    pulses = [1500 + (37 * step * (channel + 1)) % 500 - 250 for channel in range(len(vehicle.channels))]
    for topic, sample in simulation.step(pulses):
        digest.update(f"{topic} {sample!r}".encode())
print(platform.machine(), digest.hexdigest())
"""

# The way of a command to its pulses, closed by the vehicle.
PILOT_CODE = """
import hashlib, platform
from hil.autonomy.control.controller import VelocityCommand
from hil.scenario.config import build_simulation, load_scenario
from hil.slave.pilot import build_pilot
from sim.vehicle.vehicle import load_vehicle
from sim.environment.world import load_world
scenario = load_scenario("paper_field")
vehicle, control = load_vehicle(scenario.vehicle)
world = load_world(scenario.world)
simulation, pilot = build_simulation(scenario, vehicle, world), build_pilot(scenario, vehicle, control, world)
digest, pulses = hashlib.sha256(), (1500,) * len(vehicle.channels)
for step in range(8000):
    if step % 400 == 0:
        surge, sway, heading = step % 1200 / 500 - 0.8, step % 2000 / 1500 - 0.6, step / 700
        wish = VelocityCommand(surge, sway, depth=5.0 + step / 4000, heading=heading)
    if step % 8 == 0:
        pilot.set_command(wish, simulation.time_ns)
        pulses = pilot.update(simulation.time_ns, 0.02)[0].pwm_us
        digest.update(repr(pulses).encode())
    for topic, sample in simulation.step(pulses):
        pilot.update_sensor(topic, sample)
print(platform.machine(), digest.hexdigest())
"""


@pytest.fixture(scope="module")
def board() -> VirtualBoard:
    return built_board()


def run(command: list[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=900)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_flight_on_the_board_equals_one_here_bit_for_bit(board: VirtualBoard) -> None:
    ours = run([sys.executable, "-c", FLIGHT_CODE]).split()
    theirs = run(board.command("-c", FLIGHT_CODE)).split()
    assert theirs[0] == "aarch64"
    assert theirs[1] == ours[1]
    assert run(board.command("-c", FLIGHT_CODE, UUV_HIL_NATIVE="0")).split() == theirs, "the same without the C"


def test_pulses_on_the_board_equal_those_here(board: VirtualBoard) -> None:
    ours = run([sys.executable, "-c", PILOT_CODE]).split()
    theirs = run(board.command("-c", PILOT_CODE)).split()
    assert theirs == ["aarch64", ours[1]]
    assert run(board.command("-c", PILOT_CODE, UUV_HIL_NATIVE="0")).split() == theirs, "the same without the C"


def test_figures_are_labelled_as_emulated(board: VirtualBoard) -> None:
    """The label comes from the emulator's mark, or from a kernel of another processor."""
    code = "from hil.bench.machine import describe; print(*describe()[1], sep='; ')"
    assert "emulated: qemu-aarch64" in run(board.command("-c", code))
    unmarked = run(board.command("-c", f"import os; del os.environ['UUV_HIL_EMULATED']; {code}"))
    kernel = Path("/proc/sys/kernel/arch")
    if kernel.exists():  # since Linux 6.1
        assert f"emulated: aarch64 on {kernel.read_text().strip()}" in unmarked


def test_the_board_starts_its_own_python(board: VirtualBoard, tmp_path: Path) -> None:
    """The board starts sys.executable, as slaves and benchmarks do; a module of the current folder is not used."""
    (tmp_path / "hil.py").write_text("raise ImportError")
    inner = "import hil, platform, sys; print(platform.machine(), hil.__file__, sys.executable)"
    code = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {inner!r}], check=True)"
    done = subprocess.run(board.command("-c", code), capture_output=True, text=True, cwd=tmp_path, timeout=600)
    assert done.stdout.split() == ["aarch64", f"{board.site}/hil/__init__.py", board.python], done.stderr


def test_commands_run_the_boards_python(board: VirtualBoard) -> None:
    first = (Path(board.site) / "bin" / "uuv-hil").read_text().splitlines()[0]
    assert first == "#!/usr/bin/python3"
    assert (Path(board.root) / "usr/bin/python3").exists()


def test_doctor_recognises_the_emulated_board(board: VirtualBoard) -> None:
    done = subprocess.run(board.command("-m", "hil.cli", "doctor"), capture_output=True, text=True, timeout=600)
    assert "Traceback" not in done.stderr
    assert "arm64 machine" in done.stdout
    lines = {line.split()[1]: line for line in done.stdout.splitlines()}
    assert "C, " in lines["step"]
    assert "cannot be determined" not in lines["scheduling"], "another process in there can be started"


def test_a_user_defined_board_is_shown(board: VirtualBoard, tmp_path: Path) -> None:
    """These are the steps of the tutorial that need the processor of the board."""
    described, *_ = blocks("toml", page=ROOT / "docs" / "tutorials" / "own_board.md")
    file = tmp_path / "orange_pi_5.toml"
    file.write_text(described.text)
    assert "generic_arm64" in run(board.command("-m", "hil.cli", "board", "list"))
    assert run(board.command("-m", "hil.cli", "board")).startswith("an arm64 machine")
    shown = run(board.command("-m", "hil.cli", "board", "--board", str(file)))
    assert shown.startswith("Orange Pi 5\n")
    assert "budgets: start 1 s, memory 40 MiB" in shown


@pytest.fixture
def slave(board: VirtualBoard, tmp_path: Path) -> Iterator[int]:
    port = free_port()
    log = tmp_path / "slave.log"
    with log.open("w") as file:
        words = ("-m", "hil.cli", "slave", "paper_field", "--listen", f"tcp/127.0.0.1:{port}")
        process = subprocess.Popen(board.command(*words), stderr=file, cwd=tmp_path)
        try:
            assert wait_for(lambda: "ready" in log.read_text(), 300), log.read_text()
            yield port
        finally:
            process.terminate()
            assert process.wait(60) == 0, log.read_text()
    assert "thrusters neutral" in log.read_text()


def test_a_master_here_commands_a_slave_on_the_board(slave: int, tmp_path: Path) -> None:
    from hil.autonomy.control.controller import VelocityCommand
    from hil.client.client import VehicleClient

    with VehicleClient(f"tcp/127.0.0.1:{slave}", "uuv1") as client:
        assert client.wait_for_vehicle(60)
        assert wait_for(lambda: "ground_truth" in client.latest)
        before = client.get("ground_truth", 60.0).position[0]

        def moved() -> bool:
            client.command(VelocityCommand(surge=0.4))
            return bool(client.get("ground_truth", 60.0).position[0] - before > 0.5)

        assert wait_for(moved)
        assert wait_for(lambda: bool(client.diagnostics()))
