"""The public clients MAVSDK and MAVProxy command the MAVLink vehicle.

UUV_HIL_MAVSDK_PYTHON and UUV_HIL_MAVPROXY_PYTHON are Pythons that have them; `.ci/run` installs both. No test
uses a ground station with a window.
"""

import json
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.support.processes import Program, free_port, write_scenario

MAVSDK, MAVPROXY = os.environ.get("UUV_HIL_MAVSDK_PYTHON", ""), os.environ.get("UUV_HIL_MAVPROXY_PYTHON", "")
LAYOUT = (
    '[mavlink]\nendpoints = ["udpin:127.0.0.1:{udp}", "tcpin:127.0.0.1:{tcp}"]\nparameters = "{file}"\nlogs = "{logs}"'
)

SDK_SCRIPT = """
import json, sys, time
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.ftp import Ftp
from mavsdk.plugins.manual_control import ManualControl
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.mission_raw import MissionItem, MissionRaw
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import Telemetry

sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
sdk.add_any_connection(sys.argv[1])
system = sdk.first_autopilot(60.0)
param, action, mission, telemetry = Param(system), Action(system), MissionRaw(system), Telemetry(system)
direct, manual = MavlinkDirect(system), ManualControl(system)
found = {}

def wait(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.05)
    return False

def mode(number):
    fields = dict(param1=1, param2=number, param3=0, param4=0, param5=0, param6=0, param7=0, command=176,
                  confirmation=0, target_system=1, target_component=1)
    direct.send_message(MavlinkMessage("COMMAND_LONG", 0, 0, 1, 1, json.dumps(fields)))

param.set_param_float("WPNAV_SPEED", 75.0)
found["parameter"] = param.get_param_float("WPNAV_SPEED")
found["failsafe"] = param.get_param_int("FS_GCS_ENABLE")
found["parameters"] = len(param.get_all_params().float_params) + len(param.get_all_params().int_params)
found["files"] = [entry.name for entry in Ftp(system).list_directory("/logs").entries]
action.arm()
found["armed"] = wait(telemetry.armed)
mode(2)

def moves():
    manual.set_manual_control_input(0.6, 0.0, 0.5, 0.0)
    velocity = telemetry.velocity_ned()
    return abs(velocity.north_m_s) + abs(velocity.east_m_s) > 0.1

found["moves"] = wait(moves)
row = lambda i, frame, north, east, depth: MissionItem(
    i, frame, 16, int(i == 0), 1, 0, 0, 0, 0, int(north * 1e4), int(east * 1e4), depth, 0)
items = [row(0, 0, 0, 0, 0), row(1, 1, 4, 5, 2), row(2, 1, 5, 5, 2)]
mission.upload_mission(items)
found["items"] = len(mission.download_mission())
mode(3)
found["flown"] = wait(lambda: mission.mission_progress().current >= 2)
action.disarm()
found["disarmed"] = wait(lambda: not telemetry.armed())
print("FOUND " + json.dumps(found))
"""

PROXY_SCRIPT = """
import os, pexpect, sys, time
proxy = os.path.join(os.path.dirname(sys.executable), "mavproxy.py")
child = pexpect.spawn(sys.executable, [proxy, "--master=" + sys.argv[1]], encoding="utf-8", timeout=60,
                      cwd=sys.argv[2], dimensions=(40, 200))
child.logfile = sys.stdout
child.expect("online system 1")
child.expect(r"Received (\\d+) parameters \\(ftp\\)|Received (\\d+) parameters")
for line, answer in (
    ("mode ALT_HOLD", "ALT_HOLD>"), ("arm throttle", "ARMED"), ("param set WPNAV_SPEED 60", "WPNAV_SPEED|ALT_HOLD>"),
    ("param fetch WPNAV_SPEED", "WPNAV_SPEED *= *60"), ("wp list", "Saved .* waypoints|waypoints"),
    ("disarm", "DISARMED"),
):
    child.sendline(line)
    child.expect(answer)
child.sendline("exit")
time.sleep(1.0)
child.close(force=True)
print("DONE")
"""


@pytest.fixture
def places(tmp_path: Path) -> Iterator[tuple[int, int]]:
    """Provide the UDP and TCP port of a slave with a MAVLink vehicle."""
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "run.mcap").write_bytes(bytes(5000))
    udp, tcp = free_port(), free_port()
    scenario, _ = write_scenario(tmp_path)
    layout = LAYOUT.format(udp=udp, tcp=tcp, file=tmp_path / "parameters.toml", logs=tmp_path / "logs")
    scenario.write_text(scenario.read_text() + layout)
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("MAVLink system 1 is uuv1")
        yield udp, tcp


def _run(python: str, script: str, *arguments: object) -> str:
    words = [python, "-c", script, *map(str, arguments)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


@pytest.mark.skipif(not MAVSDK, reason="UUV_HIL_MAVSDK_PYTHON names no Python with mavsdk")
@pytest.mark.timeout(400)
def test_mavsdk_commands_the_vehicle(places: tuple[int, int]) -> None:
    output = _run(MAVSDK, SDK_SCRIPT, f"udpout://127.0.0.1:{places[0]}")
    (line,) = [line for line in output.splitlines() if line.startswith("FOUND ")]
    found: dict[str, Any] = json.loads(line.removeprefix("FOUND "))
    assert found.pop("parameters") > 60
    assert found.pop("parameter") == 75.0
    assert found == {
        "failsafe": 2, "files": ["run.mcap"], "armed": True, "moves": True, "items": 3, "flown": True,
        "disarmed": True,
    }  # fmt: skip


@pytest.mark.skipif(not MAVPROXY, reason="UUV_HIL_MAVPROXY_PYTHON names no Python with MAVProxy")
@pytest.mark.timeout(400)
def test_mavproxy_on_a_terminal_commands_the_vehicle(places: tuple[int, int], tmp_path: Path) -> None:
    output = _run(MAVPROXY, PROXY_SCRIPT, f"tcp:127.0.0.1:{places[1]}", tmp_path)
    assert output.rstrip().endswith("DONE")
    assert "fence breach" not in output
    assert "request timed out" not in output  # parameters came by MAVFTP
