"""Start the program of an autopilot, SITL of ArduSub or PX4, for one simulated vehicle.

It runs in a folder of that vehicle, where its logs, parameters and missions stay, and ends with this process. Its
output goes to a file there; the last lines are reported if it ends by itself.
"""

import os
import shutil
import subprocess
from contextlib import suppress

from hil.autopilots.contract import Report
from hil.autopilots.parameters import Parameters, format_parameters, number_text, read_parameters, scenario_parameters
from hil.autopilots.start_options import AIRFRAME, ardusub_options
from hil.common.children import foreign_command, start_child
from hil.common.errors import ConfigError, DeviceError
from hil.common.scratch import lock_unused
from hil.common.tables import state_path
from hil.scenario.autopilot_records import AutopilotSettings
from hil.scenario.config import Scenario
from sim.environment.world import World
from sim.vehicle.vehicle import Vehicle

LAST_LINES = 5
OFFSET = 1e-5
END_S = 3.0  # from PX4's SIGTERM, on which it completes its log, to SIGKILL
OUTPUT = "output.txt"  # what the program prints; its presence shows that a folder is an autopilot's
REMEDY = "set [autopilot] folder"
LISTED = "listed.parm"  # the parameters of the last start of PX4


class FlightFolder:
    """A folder that is made if it is missing, and locked until `close`; with `wipe` it is emptied first.

    Raises ConfigError for one with files that no autopilot's program left, or that another process has locked;
    DeviceError if it cannot be made.
    """

    def __init__(self, path: str, *, wipe: bool) -> None:
        self.path = os.path.abspath(path)
        try:
            os.makedirs(self.path, exist_ok=True)
            lock = lock_unused(self.path)
            if lock is None:
                raise ConfigError(f"{self.path}: another run uses this autopilot's folder; {REMEDY}")
            self._lock = lock
            if os.listdir(self.path) and not os.path.exists(self.file(OUTPUT)):
                self.close()
                raise ConfigError(f"{self.path}: not empty, and no autopilot's folder; {REMEDY}")
            if wipe:
                for entry in os.scandir(self.path):
                    shutil.rmtree(entry) if entry.is_dir(follow_symlinks=False) else os.remove(entry)
        except OSError as error:
            raise DeviceError(f"{self.path}: no folder for the autopilot: {error.strerror}; {REMEDY}") from None

    def file(self, name: str) -> str:
        """Return the path of a file in it."""
        return os.path.join(self.path, name)

    def close(self) -> None:
        """Release it."""
        os.close(self._lock)


class Program:
    """A running autopilot program. Raises ConfigError if there is none at its path, DeviceError if it cannot start.

    `folder`: path of the folder with its logs, parameters and missions. `log`: path of the file with its output.
    """

    def __init__(
        self, scenario: Scenario, settings: AutopilotSettings, vehicle: Vehicle, world: World, report: Report
    ) -> None:
        self._report = report
        default = state_path("autopilots", f"{scenario.slave.node}-{vehicle.name}-{scenario.controller}")
        self._folder = FlightFolder(settings.folder or default, wipe=settings.wipe)
        self.folder, self.log = self._folder.path, self._folder.file(OUTPUT)
        self._end_s = END_S if scenario.controller == "px4" else 0.0
        try:
            _, parameters = scenario_parameters(scenario, vehicle)
            if scenario.controller == "ardupilot":
                command, variables = self._ardusub(settings, scenario, world, parameters)
            else:
                command, variables = self._px4(settings, parameters)
            report(f"starting {' '.join(command)} in {self.folder}")
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
        """End PX4 by SIGTERM, and by SIGKILL what has not ended; ArduSub ignores others while it waits for a state."""
        if self._end_s:
            self._process.terminate()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(self._end_s)
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
        return [program, *ardusub_options(scenario, settings, world), "--defaults", defaults, *settings.arguments], {}

    def _px4(self, settings: AutopilotSettings, parameters: Parameters) -> tuple[list[str], dict[str, str]]:
        build = os.path.abspath(settings.program)
        program = _executable(os.path.join(build, "bin", "px4"))
        own = self._own_parameters()
        with open(self._folder.file(LISTED), "w", encoding="utf-8") as file:
            file.write(format_parameters(parameters))
        variables = {
            f"PX4_PARAM_{name}": number_text(_distinct_from_default(name, value))
            for name, value in parameters.items()
            if name not in own
        }
        variables |= {"PX4_SYS_AUTOSTART": AIRFRAME, "PX4_SIM_HOST_ADDR": "127.0.0.1"}
        command = [program, "-d", "-i", str(settings.instance), "-w", self._folder.path, os.path.join(build, "etc")]
        return [*command, *settings.arguments], variables

    def _own_parameters(self) -> Parameters:
        """Return the parameters that a person has set in PX4 to other values than were listed; report them."""
        from hil.autopilots.px4_files import changed_since, decode_bson

        stored, listed = self._folder.file("parameters.bson"), self._folder.file(LISTED)
        if not (os.path.exists(stored) and os.path.exists(listed)):
            return {}
        with open(stored, "rb") as file:
            own = changed_since(read_parameters(listed), decode_bson(file.read()))
        if own:
            values = ", ".join(f"{name} {number_text(value)}" for name, value in own.items())
            self._report(f"PX4 keeps what was set in earlier runs: {values}; [autopilot] wipe = true forgets it")
        return own


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
