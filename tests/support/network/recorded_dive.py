"""Slaves that record, and a master that commands them."""

import signal
import time
from pathlib import Path

from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import VehicleClient
from tests.support.processes import Program, write_scenario

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


def record_dive(folder: Path) -> tuple[Path, Path, str]:
    """Record a short dive: the slave's own recording, that of `uuv-hil recording make`, and the latter's output."""
    scenario, endpoint = recorded_slave(folder, "seed = 5")
    received = folder / "received"
    with Program(folder, "recording", "make", "--scenario", scenario, "-o", received) as record:
        record.expect("recording tcp")
        with Program(folder, "slave", scenario) as slave:
            slave.expect("recording into .*uuv1-")
            command_for(endpoint, 2.2)
            assert slave.stop(signal.SIGTERM) == 0
        time.sleep(0.3)
        assert record.stop(signal.SIGINT) == 0, record.output
    return own_recording(folder / "recordings"), received, record.output
