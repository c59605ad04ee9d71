"""The one command, `uuv-hil`: a table of subcommands, each imported when it is called."""

import errno
import gc
import sys
from collections.abc import Callable
from importlib import import_module

from hil.errors import STOPPED, DeviceError, HilError, MissingExtraError

# name -> module with `main(arguments) -> exit code`, and what it does
COMMANDS = {
    "demo": ("hil.commands.demo", "slave and master on this machine, one run, the HIL table"),
    "slave": ("hil.commands.slave", "be the vehicle: the daemon on the card computer"),
    "master": ("hil.commands.master", "plan and fly a scenario with a slave somewhere on the network"),
    "agent": ("hil.commands.agent", "lead one vehicle of a fleet, by what its neighbours' planners say"),
    "water": ("hil.commands.water", "be the sea between the modems of a fleet"),
    "sim": ("hil.commands.sim", "the same mission in one process, in real time or as fast as it goes"),
    "campaign": ("hil.commands.campaign", "many such runs with other seeds and parameters, on all cores"),
    "case": ("hil.commands.case", "the source paper's experiments, in the simulation and with slaves, measured"),
    "record": ("hil.commands.record", "write what vehicles say to files for Foxglove, PlotJuggler and rosbag2"),
    "replay": ("hil.commands.replay", "a recording once more: on the network, or bit for bit without a clock"),
    "plot": ("hil.commands.plot", "the figures of a recording"),
    "foxglove": ("hil.commands.foxglove", "vehicles live in Foxglove, over a websocket"),
    "bench": ("hil.commands.bench", "what a board, a link or a network can do: the HIL table and more"),
    "gateway": ("hil.commands.gateway", "vehicles for MATLAB, Octave and others: lines of JSON over TCP"),
    "loopback": ("hil.commands.loopback", "test a thruster link: losses, errors, round trips"),
    "frame": ("hil.commands.frame", "what a thruster frame says byte by byte; take bytes of a line apart"),
    "stm32": ("firmware_stub.serve", "be only the STM32, on a pty or a serial port"),
    "top": ("hil.commands.top", "how slaves are doing: loop, processor, memory, temperature, link, network"),
    "router": ("hil.commands.router", "forward between vehicles and masters that cannot reach each other"),
    "keys": ("hil.commands.keys", "certificates: who may command a vehicle, and who may listen"),
    "vehicle": ("hil.commands.vehicle", "what a vehicle is and can do; import one from a URDF"),
    "tune": ("hil.commands.tune", "gains for a vehicle's controller, from step responses in the simulator"),
    "topic": ("hil.commands.topic", "list, echo, hz and pub of ROS 2 topics, and calls of services, without ROS"),
    "world": ("hil.commands.world", "seabeds out of charts and soundings; pictures, files for other simulators"),
    "board": ("hil.commands.board", "which card computer this is, and the slave as a service of it"),
    "doctor": ("hil.commands.doctor", "whether this machine can run a scenario, and what to do where it cannot"),
}

# package as it is imported -> the extra of pyproject.toml that installs it
EXTRAS = {
    "numpy": "master",
    "joblib": "master",
    "matplotlib": "master",
    "xacro": "master",
    "cryptography": "security",
    "mcap": "recording",
    "foxglove": "foxglove",
    "scipy": "chart",
    "PIL": "imaging",
    "moderngl": "opengl",
    "rasterio": "raster",
    "pymavlink": "mavlink",
    "can": "can",
    "msgpack": "can",
    "unicorn": "unicorn",
}
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def main(arguments: list[str] | None = None) -> int:
    """Run one subcommand; its exit code. Errors a person can mend are one line on standard error."""
    arguments = sys.argv[1:] if arguments is None else arguments
    name = arguments[0] if arguments else "--help"
    if name in ("-h", "--help"):
        print(_help())
        return 0
    if name == "--version":
        from hil import __version__

        print(f"uuv-hil {__version__}")
        return 0
    if name not in COMMANDS:
        print(f"uuv-hil: no command {name!r}; there are: {', '.join(COMMANDS)} (see uuv-hil --help)", file=sys.stderr)
        return 2
    try:
        return _run(name, arguments[1:])
    except HilError as error:
        print(f"uuv-hil {name}: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return STOPPED
    except BrokenPipeError:  # `uuv-hil ... | head`
        sys.stderr.close()
        return 141


def _run(name: str, arguments: list[str]) -> int:
    """One subcommand's exit code. Raises HilError, also for a missing package of an extra, and for a full disk."""
    try:
        gc.disable()  # nothing that modules leave while they load is garbage
        run: Callable[[list[str]], int] = import_module(COMMANDS[name][0]).main
        gc.enable()
        return run(arguments)
    except ModuleNotFoundError as error:
        if error.name not in EXTRAS:
            raise
        extra = EXTRAS[error.name]
        raise MissingExtraError(f"{error.name} is not installed: pip install 'uuv-hil[{extra}]'") from None
    except OSError as error:
        if error.errno not in FULL:
            raise
        raise DeviceError(f"{error.filename or 'a file'}: {error.strerror}; free some space") from None


def _help() -> str:
    rows = "\n".join(f"  {name:9} {text}" for name, (_, text) in COMMANDS.items())
    return f"""usage: uuv-hil COMMAND [OPTIONS]

Hardware-in-the-loop bridge and simulator for unmanned underwater vehicles.

commands:
{rows}

examples:
  uuv-hil demo                                            everything on this machine
  uuv-hil slave paper_field --listen tcp/0.0.0.0:7447     on the card computer
  uuv-hil master paper_field --connect tcp/192.168.3.116:7447

uuv-hil COMMAND --help tells each command's options."""


if __name__ == "__main__":
    sys.exit(main())
