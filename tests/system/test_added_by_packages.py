"""Another package adds a thing of each kind by its entry points, and it is used by its name as ours are."""

import subprocess
import sys
from pathlib import Path

import pytest

from hil.common.children import package_environment
from hil.common.plugins import KINDS
from hil.common.schema import preset_folder

ENTRIES = {
    "planners": "straight = added.code:Straight",
    "controllers": "still = added.code:Still",
    "sensors": "thermometer = added.code:Thermometer",
    "forces": "buoy = added.code:Buoy",
    "protocols": "plain = added.code:open_plain",
    "wires": "hidden = added.code:open_hidden",
    "instruments": "pinger = added.code:Pinger",
    "gateways": "lines = added.code:serve",
    "vehicles": "my_rov = added",
    "worlds": "my_lake = added",
    "scenarios": "my_dive = added",
}
CODE = """
from hil import Done, Planner, VelocityCommand, open_address
from hil.instruments.contract import Instrument
from hil.links.frame.protocol import open_frame

class Straight(Planner):
    def __init__(self, seconds):
        self.seconds = seconds
    def command(self, time, samples):
        return Done("far enough") if time > self.seconds else VelocityCommand(surge=0.3)

class Still:
    def __init__(self, plant, gains):
        pass
    def reset(self):
        pass
    def update(self, command, navigation, dt, residual=None):
        return (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)

class Thermometer:
    message = "sensor_msgs/msg/Temperature"
    def begin(self, scene, mounting, random):
        pass
    def sample(self, time_ns, state):
        return {"temperature": 7.0}

class Buoy:
    def begin(self, time_ns):
        pass
    def wrench(self, position, rotation, nu_r):
        return (0.0,) * 6

class Pinger(Instrument):
    sensors = ("altimeter",)

def open_plain(role, thrusters, **settings):
    return open_frame(role, thrusters, **settings)

def open_hidden(target, role):
    return open_address("pty:" + target, role)

def serve(arguments):
    print("served", *arguments)
    return 0
"""
SCENARIO = """
vehicle = "my_rov"
world = "my_lake"
[link]
protocol = "plain"
port = "hidden:"
[planner]
class = "straight"
seconds = 2.0
[sensors.water]
class = "thermometer"
rate = "1 Hz"
[[force]]
class = "buoy"
[master]
goal = [2, 0]
"""


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Provide a folder in which the package `added` is installed."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "added").mkdir()
    (folder / "added" / "__init__.py").touch()
    (folder / "added" / "code.py").write_text(CODE)
    vehicle = (Path(preset_folder("sim/vehicles")) / "bluerov2.toml").read_text()
    control = vehicle.index("[control]")
    family = vehicle[control:].replace("[control]", '[control]\nfamily = "still"', 1)
    (folder / "added" / "my_rov.toml").write_text(vehicle[:control] + family)
    (folder / "added" / "my_lake.toml").write_text((Path(preset_folder("sim/worlds")) / "open_water.toml").read_text())
    (folder / "added" / "my_dive.toml").write_text(SCENARIO)
    about = folder / "added-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: added\nVersion: 1.0\n")
    groups = [f"[uuv_hil.{kind}]\n{entry}\n" for kind, entry in ENTRIES.items()]
    (about / "entry_points.txt").write_text("\n".join(groups))
    return folder


def run(packages: Path, *arguments: str, module: tuple[str, ...] = ("-m", "hil")) -> tuple[int, str]:
    environment = package_environment()
    environment["PYTHONPATH"] = f"{packages}:{environment['PYTHONPATH']}"
    command = [sys.executable, *module, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=packages, check=False)
    return done.returncode, done.stdout + done.stderr


def test_an_instrument_of_a_package_stands_at_its_wire_by_its_name(packages: Path) -> None:
    changes = "sensors.altimeter.instrument='pinger'", "sensors.altimeter.at='tcp:127.0.0.1:5099'"
    words = [word for change in changes for word in ("--set", change)]
    code, output = run(packages, "scenario", "check", "my_dive", *words)
    assert code == 0, output
    code, output = run(packages, "scenario", "check", "my_dive", *words, "--set", "sensors.imu.instrument='pinger'")
    assert (code, "'pinger' is no imu: it is for altimeter" in output) == (2, True), output


def test_each_kind_has_an_example() -> None:
    assert set(ENTRIES) == set(KINDS)


def test_a_scenario_of_a_package_flies_with_its_planner_vehicle_world_sensor_force_and_controller(
    packages: Path,
) -> None:
    code, output = run(packages, "sim", "my_dive", "--fast")
    assert (code, "far enough" in output) == (0, True), output
    code, output = run(packages, "sim", "my_dive", "--fast", "--set", "planner.class='strait'")
    assert (code, "installed packages add: straight" in output) == (2, True), output


def test_a_link_of_a_package_joins_two_ends(packages: Path) -> None:
    ends = (
        "from hil import ThrusterCommand, ThrusterLink, now_ns, open_address, open_protocol\n"
        "device = ThrusterLink(open_address('hidden:', 'device'), open_protocol('plain', 'device', 6))\n"
        "protocol = open_protocol('added.code:open_plain', 'host', 6)\n"
        "host = ThrusterLink(open_address(device.wire.name, 'host'), protocol)\n"
        "host.send(ThrusterCommand(7, True, (1500,) * 6))\n"
        "while not (messages := device.receive()): pass\n"
        "print(messages[0].sequence)\n"
    )
    assert run(packages, module=("-c", ends)) == (0, "7\n")
    code, output = run(packages, "scenario", "check", "my_dive", "--set", "link.protocol='plane'")
    assert (code, "'plane' is not one of frame, mavlink, dronecan, vesc, plain; did you mean 'plain'?" in output) == (
        2, True,
    ), output  # fmt: skip


def test_the_packages_of_the_project_are_found_beside_a_folder_of_their_name(tmp_path: Path) -> None:
    """A script's folder is searched first, so only the package `hil` itself can be hidden by one of the user's."""
    for name in ("sim", "boards", "firmware_stub"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").touch()
    script = tmp_path / "script.py"
    script.write_text("import hil\nprint(hil.load_scenario('paper_field').vehicle)\n")
    assert run(tmp_path, module=(str(script),)) == (0, "paper_six\n")
    script.write_text("import sim\nimport hil\nprint(hil.load_scenario('paper_field').vehicle)\n")
    code, output = run(tmp_path, module=(str(script),))
    assert (code, f"{tmp_path}/sim hides the package 'sim' of uuv-hil; rename that folder" in output) == (1, True)
