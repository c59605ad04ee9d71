"""The errors that a user can get, and what each one means.

    HilError                  any error of ours; the command line prints it as one line
    ├── ConfigError           a value in a file or option is invalid
    │   └── StartPositionError  the start is inside an obstacle or the seabed
    ├── DeviceError           a serial port, pty or bus cannot be opened, is busy, or was lost
    ├── NetworkError          a session cannot listen or connect, or the peer was lost
    ├── MissingExtraError     a package that this feature needs is not installed
    └── MissionError          the run did not reach the goal, or an event such as a collision failed it
        ├── NoPathError       the present map shows no path; a larger map may
        └── DivergenceError   the simulated motion is no longer finite

Each message names the file, key or port and ends with the remedy. A ConfigError has a line for each problem of a file.
Bytes from a wire never raise any of these: they are
decoded, or counted and dropped.
"""

import sys

STOPPED = 130  # exit code after a signal, as a shell gives it after Ctrl-C
EXIT_CODES = (
    "exit codes: 0 done, 1 a check found a problem, 2 a wrong file or option, 3 a device, 4 the network, 5 a missing "
    f"package, 6 the run did not end as it should, {STOPPED} Ctrl-C (0 for a command that runs until then)"
)

SHOWN = 20  # problems of a file that an error lists


class HilError(Exception):
    """Base of all errors of this project. `str(error)` names the cause and the remedy."""

    exit_code = 1


class ConfigError(HilError):
    """A scenario, vehicle, world, board or frame file, or a command-line option, is wrong.

    `args` holds one text for each problem; as text, the error lists them one a line, up to SHOWN.
    """

    exit_code = 2

    def __str__(self) -> str:
        more = len(self.args) - SHOWN
        return "\n".join([*map(str, self.args[:SHOWN]), *([f"and {more} more"] if more > 0 else [])])


class StartPositionError(ConfigError):
    """The start position of a vehicle is inside an obstacle or the seabed."""


class DeviceError(HilError):
    """A device of this machine (serial port, pty, bus) cannot be used."""

    exit_code = 3


class NetworkError(HilError):
    """The network session cannot be opened, or its peer is not present."""

    exit_code = 4


class MissingExtraError(HilError):
    """An optional package is required; the message gives the command of pip, or of pipx or uv where these installed us.

    Those keep programs in folders of their own; a new installation of ours with the extra replaces the present one.
    """

    exit_code = 5
    INSTALLERS = (("pipx/venvs", "pipx install --force"), ("uv/tools", "uv tool install --force"))

    def __init__(self, message: str = "") -> None:
        place = sys.prefix.replace("\\", "/")
        command = next((text for folder, text in self.INSTALLERS if f"/{folder}/" in place), "pip install")
        super().__init__(message.replace("pip install", command))


class MissionError(HilError):
    """The mission did not reach the scenario's goal, or an event such as a collision failed it.

    `subject` is "start", "goal" or "path" if one of these is the reason.
    """

    exit_code = 6

    def __init__(self, message: str = "", subject: str = "") -> None:
        super().__init__(message)
        self.subject = subject


class NoPathError(MissionError):
    """A map shows no path between two positions, or does not contain both; a larger map may."""


class DivergenceError(MissionError):
    """The state of a simulated vehicle is no longer finite; the message names the time and the term."""


ELSEWHERE = "on this system run sim, master, view, topic, the gateways, and what needs no board"


def require_linux(what: str) -> None:
    """Raise DeviceError on systems other than Linux; `what` names the feature."""
    if sys.platform != "linux":
        raise DeviceError(f"{what} runs on Linux only, and this is {sys.platform}; {ELSEWHERE}")
