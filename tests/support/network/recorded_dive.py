"""Slaves that record, and a master that commands them."""

import time
from pathlib import Path

from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import VehicleClient
from tests.support.processes import write_scenario

RECORDING = '[recording]\nslave = true\nmaster = true\nfolder = "{folder}"\nkeep_free = 0\n'


def command_for(endpoint: str, seconds: float) -> int:
    """Fly a curve for so long, with at least 30 commands and 200 IMU samples; return the number of commands."""
    with VehicleClient(endpoint, "uuv1") as client:
        assert client.wait_for_vehicle(60)
        end, count = time.monotonic() + seconds, 0
        while time.monotonic() < end or count < 30 or client.received["imu"] < 200:
            client.command(VelocityCommand(surge=0.5, heave=0.1, yaw_rate=0.3))
            count += 1
            time.sleep(0.05)
    return count + 1


def own_recording(folder: Path) -> Path:
    (made,) = folder.iterdir()
    return made


def recorded_slave(tmp_path: Path, top: str = "") -> tuple[Path, str]:
    scenario, port = write_scenario(tmp_path, top=top)
    with scenario.open("a") as file:
        file.write(RECORDING.format(folder=tmp_path / "recordings"))
    return scenario, f"tcp/127.0.0.1:{port}"
