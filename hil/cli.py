"""The one command, `uuv-hil`: a table of subcommands, each imported when it is called."""

import sys

from hil.common import lifeline

# True where this process is the command
if __name__ == "__main__" or (sys.argv[:1] and sys.argv[0].endswith(("/uuv-hil", "/hil/__main__.py"))):
    lifeline.leave_on_ctrl_c()  # until all modules are loaded

import errno
import gc
import os
from collections.abc import Callable
from importlib import import_module

from hil.common import streams
from hil.common.errors import EXIT_CODES, STOPPED, ConfigError, DeviceError, HilError, MissingExtraError, MissionError

# name -> module with `main(arguments) -> exit code`, and what it does
COMMANDS = {
    "demo": ("hil.commands.demo", "run slave and master on this machine, then print the HIL table"),
    "slave": ("hil.commands.slave", "run the vehicle daemon on the board"),
    "master": ("hil.commands.master", "plan and fly a scenario with a slave somewhere on the network"),
    "agent": ("hil.commands.agent", "plan for one vehicle of a fleet, beside its neighbours' planners"),
    "channel": ("hil.commands.channel", "simulate the acoustic or optical channel between the modems of a fleet"),
    "scenario": ("hil.commands.files.scenario", "list, show, copy and check scenarios"),
    "schema": (
        "hil.commands.files.schema",
        "print JSON Schemas of all files, for editors that complete and check TOML",
    ),
    "sim": ("hil.commands.sim.command", "fly the same mission in one process, in real time or as fast as it goes"),
    "autopilot": ("hil.commands.autopilot", "test motors and connection of an autopilot, show its parameters"),
    "campaign": (
        "hil.commands.campaign.command",
        "run a mission many times, with other seeds and parameters",
    ),
    "case": ("hil.commands.case", "repeat the reference platform's experiments, simulated and with slaves"),
    "record": ("hil.commands.recording.record", "record what vehicles publish, for Foxglove, PlotJuggler and rosbag2"),
    "replay": ("hil.commands.recording.replay", "replay a recording on the network, or bit for bit without a clock"),
    "plot": ("hil.commands.recording.plot", "draw the figures of a recording"),
    "view": ("hil.commands.view.command", "show vehicles live in a browser, and steer them"),
    "teleop": ("hil.commands.view.teleop", "steer a vehicle from a terminal, by keys or with a gamepad"),
    "foxglove": ("hil.commands.gateways.foxglove", "show vehicles live in Foxglove, over a websocket"),
    "bench": ("hil.commands.bench.command", "measure a board, a link or a network: the HIL table and more"),
    "rosbridge": ("hil.commands.gateways.rosbridge", "serve vehicles to web pages and tools that speak rosbridge"),
    "ros1": ("hil.commands.gateways.ros1", "serve vehicles to a ROS 1 network (Noetic), and command them from there"),
    "gateway": ("hil.commands.gateways.gateway", "serve vehicles to MATLAB, Octave and others: lines of JSON over TCP"),
    "mavlink": ("hil.commands.gateways.mavlink", "serve a vehicle to QGroundControl and other MAVLink software"),
    "loopback": ("hil.commands.loopback", "test a thruster link: losses, errors, round trips"),
    "frame": ("hil.commands.frame", "describe a thruster frame byte by byte; decode bytes of a line"),
    "stm32": ("hil.commands.stm32.command", "emulate the STM32 alone; flash a real one, and check its outputs"),
    "top": ("hil.commands.top.command", "show the health of slaves: loop, processor, memory, temperature, links"),
    "router": ("hil.commands.router", "forward between vehicles and masters that cannot reach each other"),
    "fleet": ("hil.commands.fleet", "start, show and stop the slaves of a fleet, here and on hosts over ssh"),
    "keys": ("hil.commands.keys", "make certificates: who may command a vehicle, and who may listen"),
    "vehicle": ("hil.commands.vehicle.command", "describe a vehicle and what it can do; import one from URDF or SDF"),
    "tune": ("hil.commands.tune", "find gains for a vehicle's controller from step responses"),
    "topic": (
        "hil.commands.topic.command",
        "list, echo, measure and publish ROS 2 topics, and call services, without ROS",
    ),
    "world": ("hil.commands.world", "build worlds from charts and soundings; draw and export them"),
    "board": ("hil.commands.board.command", "identify this board; install the slave as its service"),
    "completion": ("hil.commands.completion", "let bash, zsh or fish complete commands, options and keys"),
    "doctor": ("hil.commands.doctor", "check whether this machine can run a scenario, and what to change"),
}

# heading of the help -> its commands
GROUPS = {
    "fly": ("demo", "sim", "slave", "master", "agent", "channel", "fleet", "router", "view", "teleop"),
    "describe what flies": ("scenario", "vehicle", "world", "frame", "schema"),
    "record and look": ("record", "replay", "plot", "top", "topic"),
    "connect other software": ("autopilot", "mavlink", "gateway", "foxglove", "rosbridge", "ros1"),
    "measure and repeat": ("bench", "loopback", "campaign", "case", "tune"),
    "set up a machine": ("doctor", "board", "stm32", "keys", "completion"),
}

EXAMPLES = (
    "  uuv-hil demo                                           all on this machine",
    "  uuv-hil slave paper_field --listen tcp/0.0.0.0:7447    on the board",
    "  uuv-hil master paper_field --connect tcp/192.168.3.116:7447",
)

# package as it is imported -> the extra of pyproject.toml that installs it
EXTRAS = {
    "numpy": "master",
    "joblib": "master",
    "matplotlib": "master",
    "xacro": "master",
    "yaml": "master",
    "argcomplete": "master",
    "cryptography": "security",
    "mcap": "recording",
    "foxglove": "foxglove",
    "cbor2": "rosbridge",
    "rosbags": "ros1",
    "viser": "view",
    "pygame": "teleop",
    "aiohttp": "view",
    "trimesh": "view",
    "contourpy": "view",
    "collada": "mesh",
    "gsw": "ocean",
    "scipy": "chart",
    "pyogrio": "chart",
    "shapely": "chart",
    "pygeomag": "chart",
    "PIL": "imaging",
    "moderngl": "opengl",
    "rasterio": "raster",
    "h5py": "raster",
    "laspy": "raster",
    "pymavlink": "mavlink",
    "av": "video",
    "can": "can",
    "msgpack": "can",
    "unicorn": "unicorn",
    "pyocd": "flash",
    "distributed": "cluster",
    "ray": "cluster",
}
# What is a board, or measures one: real-time scheduling, pseudo terminals, /proc.
LINUX_ONLY = ("demo", "slave", "stm32", "loopback", "board", "doctor")
UNIX = ("fcntl", "termios", "pwd")  # modules that Windows lacks
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def main(arguments: list[str] | None = None) -> int:
    """Run one subcommand; return its exit code. Errors that a user can correct are one line on standard error."""
    lifeline.die_with_parent()
    name = "uuv-hil"
    try:
        if "_ARGCOMPLETE" in os.environ:  # the shell asks what may come next
            from hil.commands.completion import answer_shell

            answer_shell(COMMANDS)
        if arguments is None:
            streams.prepare()
        words = sys.argv[1:] if arguments is None else arguments
        name = f"uuv-hil {words[0]}" if words and words[0] in COMMANDS else name
        try:
            return _dispatch(words)
        finally:
            sys.stdout.flush()  # we report what cannot be written, not the interpreter as it ends
    except HilError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return STOPPED
    except BrokenPipeError:  # `uuv-hil ... | head`
        streams.drop_output()
        return 141
    except Exception as error:
        if isinstance(error, OSError) and error.errno in FULL:
            streams.drop_output()
            print(f"{name}: {error.filename or 'the output'}: {error.strerror}; free some space", file=sys.stderr)
            return DeviceError.exit_code
        if _print_own_traceback(name, error):
            return MissionError.exit_code
        raise


def _print_own_traceback(name: str, error: Exception) -> bool:
    """Print what a class of the user's raised, from its own lines on; False if the exception is of none."""
    from hil.common.plugins import own_traceback

    own = own_traceback(error)
    if own is None:
        return False
    import traceback

    print(f"{name}: an error in {os.path.basename(own.tb_frame.f_code.co_filename)}, a file of yours:", file=sys.stderr)
    traceback.print_exception(type(error), error, own)
    return True


def _dispatch(arguments: list[str]) -> int:
    """Return one subcommand's exit code, or that of --help and --version. Raises HilError, OSError."""
    if arguments[:1] == ["help"]:  # `uuv-hil help scenario check` is `uuv-hil scenario check --help`
        arguments = [*arguments[1:], "--help"]
    name = arguments[0] if arguments else "--help"
    if name in ("-h", "--help"):
        print(_help())
        return 0
    if name in ("-V", "--version"):
        from hil.common import __version__

        print(f"uuv-hil {__version__}")
        return 0
    if name not in COMMANDS:
        from hil.common.schema import nearest

        raise ConfigError(f"no command {name!r}{nearest(name, list(COMMANDS))}; there are: {', '.join(COMMANDS)}")
    return _run(name, arguments[1:])


def _run(name: str, arguments: list[str]) -> int:
    """Return one subcommand's exit code. Raises HilError, also for a missing package of an extra."""
    if name in LINUX_ONLY and sys.platform != "linux":
        from hil.common.errors import require_linux

        require_linux(name)
    try:
        gc.disable()  # nothing that modules leave while they load is garbage
        run: Callable[[list[str]], int] = import_module(COMMANDS[name][0]).main
        gc.enable()
        lifeline.raise_on_ctrl_c()
        return run(arguments)
    except ModuleNotFoundError as error:
        if error.name in UNIX:
            raise DeviceError(f"this system has no {error.name}: the command runs on Linux and macOS") from None
        if error.name not in EXTRAS:
            raise
        extra = EXTRAS[error.name]
        raise MissingExtraError(f"{error.name} is not installed: pip install 'uuv-hil[{extra}]'") from None


def _help() -> str:
    from hil.common.columns import aligned, paragraph, terminal_width
    from hil.common.text import wrap_command

    width = max(map(len, COMMANDS))
    rows = ""
    for heading, names in GROUPS.items():
        lines = aligned([(name.ljust(width), COMMANDS[name][1]) for name in names], indent="  ")
        rows += "\n".join(["", f"{heading}:", *lines, ""])
    examples = "\n".join([piece for line in EXAMPLES for piece in wrap_command(line, terminal_width())])
    more = "uuv-hil COMMAND --help, or uuv-hil help COMMAND, shows each command's options, uuv-hil -V the version."
    return f"""usage: uuv-hil COMMAND [OPTIONS]

{paragraph("Hardware-in-the-loop bridge and simulator for unmanned underwater vehicles.")}
{rows}
examples:
{examples}

{paragraph(more)}

{paragraph(EXIT_CODES)}"""


if __name__ == "__main__":
    sys.exit(main())
