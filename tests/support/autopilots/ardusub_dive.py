"""A dive of the real ArduSub, whose SITL program UUV_HIL_ARDUSUB names."""

import os
from math import hypot
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.scenario.config import load_scenario
from tests.support.autopilots.autopilot_dive import ARM, SET_MODE, WORLD, AutopilotDive
from tests.support.clients.ground_station import GroundStation, Mission

PROGRAM = os.environ.get("UUV_HIL_ARDUSUB", "")
SCENARIO = """
vehicle = "{vehicle}"
world = "{world}"
controller = "ardupilot"
master = {{}}
[start]
depth = 0
[autopilot]
program = "{program}"
folder = "ardusub"
wipe = true
instance = {instance}
positions = "{positions}"
{autopilot}
[sensors.imu]
rate = 400
[sensors.pressure]
rate = 50
{pressure}
[sensors.altimeter]
[sensors.odometry]
rate = 20
{sensors}
"""
GPS = """
[sensors.gps]
rate = 5
acquisition = 0
position = [0, 0, -0.4]
"""
MANUAL, ALT_HOLD, GUIDED, POSHOLD = 19, 2, 4, 16


class Dive(AutopilotDive):
    """One ArduSub with its vehicle and a ground station."""

    def __init__(
        self, folder: Path, vehicle: str = "bluerov2_heavy", instance: int = 3, pressure: str = "",
        positions: str = "simulated", autopilot: str = "", sensors: str = ""
    ) -> None:  # fmt: skip
        world, path = folder / "stream.toml", folder / "dive.toml"
        world.write_text(WORLD)
        text = SCENARIO.format(
            vehicle=vehicle, world=world, program=PROGRAM, instance=instance, pressure=pressure, positions=positions,
            autopilot=autopilot, sensors=sensors,
        )  # fmt: skip
        path.write_text(text)
        super().__init__(load_scenario(str(path)), GroundStation(("127.0.0.1", 5760 + 10 * instance)))

    def dive(self, depth: float) -> Mission:
        """Arm, dive with the joystick, and hold depth."""
        yield lambda: self.station.output("ArduPilot Ready")
        yield from self.command(ARM, 1)
        self.station.sticks = (0, 0, 300, 0)
        yield lambda: self.position[2] > depth
        self.station.sticks = (0, 0, 500, 0)
        yield from self.command(SET_MODE, 1, ALT_HOLD)
        yield 15.0

    def go(self, north: float, east: float, depth: float) -> Mission:
        """Go to a position (m from the estimator's origin) in GUIDED; sent once, as each target begins from rest."""
        mask = 0b1101_1111_1000  # positions only
        message = dialect.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, dialect.MAV_FRAME_LOCAL_NED, mask, north, east, depth, 0, 0, 0, 0, 0, 0, 0, 0
        )
        self.station.send(message)
        local = self.station.latest
        yield lambda: hypot(local["LOCAL_POSITION_NED"].x - north, local["LOCAL_POSITION_NED"].y - east) < 0.5
