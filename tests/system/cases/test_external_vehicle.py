"""A planner with a vehicle of external software, which reads `cmd_vel` and commands the thrusters."""

import json
import time
from pathlib import Path

import serial

from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import VehicleClient
from hil.common.clock import now_ns
from hil.common.schema import find_preset
from hil.links.frame.protocol import FrameProtocol
from hil.scenario.config import load_scenario
from hil.slave.pilot import build_pilot
from sim.environment.world import load_world
from sim.vehicle.vehicle import load_vehicle
from tests.support.processes import Program, free_port, write_scenario

SENSOR_TOPICS = ("imu", "odom", "pressure")


def run_external_vehicle(client: VehicleClient, scenario_path: Path, device: Path, master: Program) -> int:
    """Subscribe to sensors and commands as a ROS 2 node would, command the thrusters; return the commands."""
    scenario = load_scenario(str(scenario_path))
    vehicle, control = load_vehicle(scenario.vehicle)
    pilot = build_pilot(scenario, vehicle, control, load_world(scenario.world))
    protocol = FrameProtocol(find_preset("firmware_stub/frames", "uuv_hil"))
    received_count, last = 0, 0
    with serial.Serial(str(device), 115_200, timeout=0.0, exclusive=True) as port:
        while master.process.poll() is None:
            for topic in SENSOR_TOPICS:
                if topic in client.latest:
                    pilot.update_sensor(topic, client.latest[topic].value)
            command = client.latest.get("cmd_vel")
            if command and command.received_ns != last:
                last = command.received_ns
                linear, angular = command.value
                pilot.set_command(VelocityCommand(linear[0], linear[1], linear[2], angular[2]), now_ns())
                received_count += 1
            port.write(protocol.encode(pilot.update(now_ns(), 0.02)[0]))
            port.read(1000)
            time.sleep(0.02)
    return received_count


def test_the_planner_leads_a_vehicle_with_external_software(tmp_path: Path) -> None:
    device, folder = tmp_path / "stm32", tmp_path / "run"
    path, _ = write_scenario(tmp_path, top='controller = "external"', link=f'port = "pty:{device}"')
    router = f"tcp/127.0.0.1:{free_port()}"
    text = path.read_text().replace("goal = [8, 7]", "goal = [6.5, 5]")
    path.write_text(f'{text}[network]\nmode = "routed"\nrouter = "{router}"\n')
    with Program(tmp_path, "router", "--listen", router) as between, Program(tmp_path, "slave", path) as slave:
        between.expect("forwarding")
        slave.expect("waiting for your software")
        network = load_scenario(str(path)).network
        with (
            VehicleClient(router, "uuv1", role="observer", network=network) as client,
            Program(tmp_path, "master", path, "--connect", router, "--output", folder) as master,
        ):
            assert client.wait_for_vehicle(60)
            received_count = run_external_vehicle(client, path, device, master)
            assert master.wait() == 0, master.output
    outcome = json.loads((folder / "table.json").read_text())["outcome"]
    assert outcome["reason"] == "goal reached"
    assert outcome["least_clearance"] > 0.3
    assert received_count > 40
