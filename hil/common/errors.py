"""The errors that a person can get, and what each one means.

    HilError                  anything of ours; the command line prints it as one line
    ├── ConfigError           a file or an option says something that cannot be meant
    ├── DeviceError           a serial port, pty or bus cannot be opened, is busy, or went away
    ├── NetworkError          a session cannot listen or connect, or the other side went away
    ├── MissingExtraError     a package that this feature needs is not installed
    └── MissionError          the run ended without reaching what the scenario asked for
        ├── NoPathError       the map at hand shows no path; a map of more of the world may
        └── DivergenceError   the simulated motion left the finite numbers

Each message names the file, key or port it is about and ends with the remedy. What arrives over a wire
never raises any of these: it is decoded, or counted and dropped.
"""

import sys

STOPPED = 130  # the exit code of what a person or a signal has ended, as of a shell after Ctrl-C
EXIT_CODES = (
    "exit codes: 0 done, 1 a check found a problem, 2 a wrong file or option, 3 a device, 4 the network, 5 a missing "
    f"package, 6 the run did not end as it should, {STOPPED} Ctrl-C (0 for a command that runs until then)"
)


class HilError(Exception):
    """Base of all errors of this project. `str(error)` is one line that names the cause and the remedy."""

    exit_code = 1


class ConfigError(HilError):
    """A scenario, vehicle, world, board or frame file, or a command-line option, is wrong."""

    exit_code = 2


class DeviceError(HilError):
    """A device of this machine (serial port, pty, bus) cannot be used."""

    exit_code = 3


class NetworkError(HilError):
    """The network session cannot be opened, or the peer it was opened for is not there."""

    exit_code = 4


class MissingExtraError(HilError):
    """An optional package is needed; the message gives the pip command."""

    exit_code = 5


class MissionError(HilError):
    """The mission was run and did not end as the scenario asked."""

    exit_code = 6


class NoPathError(MissionError):
    """A map shows no path between two places, or not both of them: one of more of the world may."""


class DivergenceError(MissionError):
    """The state of a simulated vehicle is not finite any more; the message names the time and the term."""


ELSEWHERE = "on this system run sim, master, view, topic, the gateways, and what needs no board"


def require_linux(what: str) -> None:
    """Raise DeviceError, in one line, on a system that cannot do `what`."""
    if sys.platform != "linux":
        raise DeviceError(f"{what} runs on Linux only, and this is {sys.platform}; {ELSEWHERE}")
