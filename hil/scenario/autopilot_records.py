"""The section [autopilot] of a scenario: the flight controller that controls the vehicle."""

import os
from typing import Annotated, Literal, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import Range
from hil.links.address import parse_address

PORTS = {"ardupilot": 9002, "px4": 4560}  # port of the first instance
STEP = {"ardupilot": 10, "px4": 1}  # difference of ports between instances
GROUND_PORT = 5760  # of the first ArduPilot instance: its SERIAL0, MAVLink over TCP
COMPANION_PORT = 5765  # of its SERIAL5, the same; ground stations and scripts use 5760, 5762 and 5763
Positions = Literal["simulated", "odometry", "dvl", "gps"]


class AutopilotSettings(NamedTuple):
    """Settings of the autopilot: its address, the motors that it drives, and the pace of simulated time.

    `program` is ArduSub's SITL program or PX4's build folder; the slave or `uuv-hil sim` starts it, with additional
    `arguments`. Without it, the user starts the autopilot. It runs in `folder`, where its logs, parameters and
    missions stay until a start with `wipe`; by default one for each node and vehicle in
    ~/.local/state/uuv-hil/autopilots. `parameters` is a parameter file (.parm), by default the installed one for
    the vehicle, if there is one. `frame` is a file of hil/autopilots/frames, "auto" or "custom". `instance` shifts
    the ports. `address` is where we listen (udp://, tcp://) or a board's device; the default is the interface's own
    address on this machine. `baud` is for a serial device. With `lockstep` simulated time waits for the autopilot.
    After `silence` without outputs the thrusters go to neutral. `rate` is the rate of PX4's HIL_SENSOR.
    `positions` is the position source of the estimator: a GPS that ArduPilot simulates itself from the true position,
    or messages with samples of our sensors, as from a companion computer; PX4 gets them in any case.
    """

    program: str = ""
    arguments: tuple[str, ...] = ()
    folder: str = ""
    wipe: bool = False
    parameters: str = ""
    frame: str = "auto"
    instance: Annotated[int, Range(0, 9)] = 0
    address: str = ""
    baud: Annotated[int, Range(1200, 12_000_000, "bit/s")] = 921_600
    lockstep: bool = True
    silence: Annotated[float, Range(0.02, 10.0, "s")] = 0.2
    rate: Annotated[float, Range(10.0, 250.0, "Hz")] = 250.0
    positions: Positions = "simulated"

    def validate(self) -> str | None:
        """Return why an address is invalid; None if all are valid."""
        text = self.address
        try:
            if text and parse_address(text).carries_can:
                return f"address: {text!r}: an autopilot is reached by udp://, tcp:// or a serial device, not by CAN"
        except ConfigError as error:
            return f"address: {error}"
        return None

    def own_address(self, controller: str) -> str:
        """Return the address, by default that of the interface for this instance."""
        scheme = "udp" if controller == "ardupilot" else "tcp"
        return self.address or f"{scheme}://127.0.0.1:{PORTS[controller] + STEP[controller] * self.instance}"

    def resolve_paths(self, folder: str) -> "AutopilotSettings":
        """Return a copy with paths relative to the folder of the scenario file."""

        def placed(text: str) -> str:
            path = os.path.expanduser(text)
            is_path = os.path.sep in path or path.endswith((".parm", ".params", ".toml"))
            return os.path.join(folder, path) if is_path else path

        program, parameters, frame = map(placed, (self.program, self.parameters, self.frame))
        own = os.path.join(folder, os.path.expanduser(self.folder)) if self.folder else ""
        return self._replace(program=program, parameters=parameters, frame=frame, folder=own)
