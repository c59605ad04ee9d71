"""Start the program of an autopilot, SITL of ArduSub or PX4, for one simulated vehicle.

It runs in a new, temporary folder, so that every start is the same, and ends with this process. Its output goes to a
file there; the last lines are reported if it ends by itself.
"""

import os
import subprocess
from math import degrees

from hil.autopilots.contract import Report
from hil.autopilots.frames import AUTO, CUSTOM, map_motors
from hil.autopilots.inputs import HOME
from hil.autopilots.parameters import Parameters, all_parameters, format_parameters
from hil.common.children import foreign_command, start_child
from hil.common.errors import ConfigError, DeviceError
from hil.common.scratch import ScratchFolder
from hil.links.address import parse_address
from hil.scenario.autopilot_records import AutopilotSettings
from hil.scenario.config import Scenario
from sim.environment.world import World
from sim.vehicle.vehicle import Vehicle

SPEEDUP = 100  # faster than any run: this process sets the simulation time, the program waits for it
AIRFRAME = "1022"  # PX4's underwater vehicle; parameters then set its geometry
LAST_LINES = 5
OFFSET = 1e-5


class Program:
    """A running autopilot program. Raises ConfigError if there is none at its path, DeviceError if it cannot start.

    `log`: path of the file with its output, which exists while it runs.
    """

    def __init__(
        self, scenario: Scenario, settings: AutopilotSettings, vehicle: Vehicle, world: World, report: Report
    ) -> None:
        self._report = report
        self._folder = ScratchFolder("autopilot")
        self.log = self._folder.file("output.txt")
        try:
            frame = CUSTOM if scenario.controller == "px4" and settings.frame == AUTO else settings.frame
            motors = map_motors(frame, vehicle)
            parameters = all_parameters(settings, scenario.controller, vehicle, motors, scenario.sensors)
            if scenario.controller == "ardupilot":
                command, variables = self._ardusub(settings, scenario, world, parameters)
            else:
                command, variables = self._px4(settings, parameters)
            report(f"starting {' '.join(command)}")
            with open(self.log, "wb") as output:
                self._process = start_child(
                    foreign_command(*command),
                    environment={**os.environ, **variables},
                    cwd=self._folder.path,
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                )
        except OSError as error:
            self._folder.close()
            raise DeviceError(f"{settings.program}: cannot be started: {error.strerror}") from None
        except BaseException:
            self._folder.close()
            raise

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    def ended(self) -> str | None:
        """Return its exit status and last lines of output as text; None while it runs."""
        status = self._process.poll()
        if status is None:
            return None
        with open(self.log, encoding="utf-8", errors="replace") as file:
            last = [line.strip() for line in file.read()[-4000:].splitlines() if line.strip()][-LAST_LINES:]
        return f"the autopilot's program has ended with status {status}: {' | '.join(last)}"

    def close(self) -> None:
        """End it by SIGKILL: ArduSub ignores other signals while it waits for a state."""
        self._process.kill()
        self._process.wait()
        self._folder.close()

    def _ardusub(
        self, settings: AutopilotSettings, scenario: Scenario, world: World, parameters: Parameters
    ) -> tuple[list[str], dict[str, str]]:
        program = _executable(settings.program)
        defaults = self._folder.file("defaults.parm")
        with open(defaults, "w", encoding="utf-8") as file:
            file.write(format_parameters(parameters))
        address = parse_address(settings.own_address("ardupilot"))
        latitude, longitude = world.origin or HOME
        home = f"{latitude:.7f},{longitude:.7f},0,{degrees(scenario.start.heading):.1f}"
        own = ["--model", f"JSON:{address.target}", "--speedup", str(SPEEDUP), "-I", str(settings.instance), "--wipe"]
        own += ["--serial0", "tcp:0"]  # the default port, but without waiting for a connection
        ports = ["--sim-port-out", str(address.port), "--home", home, "--defaults", defaults]
        return [program, *own, *ports, *settings.arguments], {}

    def _px4(self, settings: AutopilotSettings, parameters: Parameters) -> tuple[list[str], dict[str, str]]:
        build = os.path.abspath(settings.program)
        program = _executable(os.path.join(build, "bin", "px4"))
        variables = {
            f"PX4_PARAM_{name}": f"{_distinct_from_default(name, value):g}" for name, value in parameters.items()
        }
        variables |= {"PX4_SYS_AUTOSTART": AIRFRAME, "PX4_SIM_HOST_ADDR": "127.0.0.1"}
        command = [program, "-d", "-i", str(settings.instance), "-w", self._folder.path, os.path.join(build, "etc")]
        return [*command, *settings.arguments], variables


def _distinct_from_default(name: str, value: float) -> float:
    """Return `value` with an offset of 1e-5 for the direction and position of a motor, where it has no effect.

    PX4 does not store a value equal to the firmware's default; the airframe's value would then be used instead.
    """
    return value + OFFSET if name.startswith("CA_ROTOR") and name[-2:-1] in ("A", "P") else value


def _executable(path: str) -> str:
    if not os.access(path, os.X_OK) or os.path.isdir(path):
        raise ConfigError(
            f"[autopilot] program: {path}: not a program; give the path of ArduSub's SITL program (ardusub), or of "
            "PX4's build folder (build/px4_sitl_default)"
        )
    return os.path.abspath(path)
