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
from hil.common.stop import every_end_like_ctrl_c

# name -> module with `main(arguments) -> exit code`, and what it does. The first word of two names a family.
COMMANDS = {
    "demo": ("hil.commands.demo", "run slave and master on this machine, then print the HIL table"),
    "sim": ("hil.commands.sim.command", "fly the same mission in one process, in real time or as fast as it goes"),
    "slave": ("hil.commands.slave", "run the vehicle daemon on the board"),
    "master": ("hil.commands.master", "plan and fly a scenario with a slave somewhere on the network"),
    "fleet": ("hil.commands.fleet", "start and stop the slaves of a fleet; run its planners and modems"),
    "router": ("hil.commands.router", "forward between vehicles and masters that cannot reach each other"),
    "view": ("hil.commands.view.command", "show vehicles live in a browser, and steer them"),
    "scenario": ("hil.commands.files.scenario", "list, show, copy and check scenarios; print the files' schemas"),
    "vehicle": ("hil.commands.vehicle.command", "describe a vehicle and what it can do; import one from URDF or SDF"),
    "world": ("hil.commands.world", "build worlds from charts and soundings; draw and export them"),
    "recording make": (
        "hil.commands.recording.record",
        "record what vehicles publish, for Foxglove, PlotJuggler and rosbag2",
    ),
    "recording replay": (
        "hil.commands.recording.replay",
        "replay a recording on the network, or bit for bit without a clock",
    ),
    "recording plot": ("hil.commands.recording.plot", "draw the figures of a recording"),
    "top": ("hil.commands.top", "show the health of slaves: loop, processor, memory, temperature, links"),
    "topic": (
        "hil.commands.topic",
        "list, echo, measure and publish ROS 2 topics, and call services, without ROS",
    ),
    "gateway mavlink": ("hil.commands.gateways.mavlink", "QGroundControl and other MAVLink software"),
    "gateway json": ("hil.commands.gateways.json_lines", "MATLAB, Octave and others: lines of JSON over TCP"),
    "gateway foxglove": ("hil.commands.gateways.foxglove", "Foxglove, over a websocket"),
    "gateway rosbridge": ("hil.commands.gateways.rosbridge", "web pages and tools that speak rosbridge"),
    "gateway ros2": ("hil.commands.gateways.ros2", "ROS 2 nodes with FastDDS, Cyclone or another middleware"),
    "gateway ros1": ("hil.commands.gateways.ros1", "a ROS 1 network (Noetic), with commands from there"),
    "instruments": (
        "hil.commands.instruments.command",
        "serve the instruments of a vehicle at their wires",
    ),
    "instruments check": ("hil.commands.instruments.check", "show what a driver sees at each wire, and how late"),
    "autopilot": ("hil.commands.autopilot", "test motors and connection of an autopilot, show its parameters"),
    "bench table": (
        "hil.commands.bench.table",
        "master CPU, start-up, memory and command delay, beside the reference platform's",
    ),
    "bench delay": ("hil.commands.bench.delay", "where a command's time goes, by load, rate, link, STM32"),
    "bench echo": (
        "hil.commands.bench.echo",
        "echo bare messages beside a slave elsewhere, for the floor of the delay",
    ),
    "bench startup": ("hil.commands.bench.startup", "what a start costs, cold and warm, phase by phase"),
    "bench load": ("hil.commands.bench.load", "CPU and memory over time, by sensors, rates and numbers of vehicles"),
    "bench stream": ("hil.commands.bench.stream", "what reaches the master: rates, loss, age, bandwidth"),
    "bench soak": ("hil.commands.bench.soak", "hours of running: growth, drift, reconnects"),
    "link loopback": ("hil.commands.loopback", "test a thruster link: losses, errors, round trips"),
    "link frame": ("hil.commands.frame", "describe a thruster frame byte by byte; decode bytes of a line"),
    "campaign": ("hil.commands.campaign", "run a mission many times, with other seeds and parameters"),
    "case": ("hil.commands.case", "repeat the reference platform's experiments, simulated and with slaves"),
    "tune": ("hil.commands.tune", "find gains for a vehicle's controller from step responses"),
    "doctor": ("hil.commands.doctor", "check whether this machine can run a scenario, and what to change"),
    "board": ("hil.commands.board.command", "identify this board; install the slave as its service"),
    "stm32": ("hil.commands.stm32.command", "emulate the STM32 alone; flash a real one, and check its outputs"),
    "keys": ("hil.commands.keys", "make certificates: who may command a vehicle, and who may listen"),
    "completion": ("hil.commands.completion", "let bash, zsh or fish complete commands, options and keys"),
}

# first word of the names of a family -> what its commands do
FAMILIES = {
    "recording": "record what vehicles publish; replay and draw recordings",
    "gateway": "serve vehicles to other software: MAVLink, JSON, Foxglove, rosbridge, ROS 1 and 2",
    "bench": "measure a board, a link or a network: the HIL table and more",
    "link": "test a thruster link, and describe its frames",
}

# heading of the help -> its commands and families
GROUPS = {
    "fly": ("demo", "sim", "slave", "master", "fleet", "router", "view"),
    "describe what flies": ("scenario", "vehicle", "world"),
    "record and look": ("recording", "top", "topic"),
    "connect other software": ("gateway", "instruments", "autopilot"),
    "measure and repeat": ("bench", "link", "campaign", "case", "tune"),
    "set up a machine": ("doctor", "board", "stm32", "keys", "completion"),
}

# former name -> present one
ALIASES = {
    "agent": "fleet agent",
    "channel": "fleet channel",
    "schema": "scenario schema",
    "record": "recording make",
    "replay": "recording replay",
    "plot": "recording plot",
    "mavlink": "gateway mavlink",
    "foxglove": "gateway foxglove",
    "rosbridge": "gateway rosbridge",
    "ros1": "gateway ros1",
    "ros2": "gateway ros2",
    "gateway": "gateway json",
    "loopback": "link loopback",
    "frame": "link frame",
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
    "aiohttp": "view",
    "trimesh": "view",
    "collada": "mesh",
    "scipy": "chart",
    "pyogrio": "chart",
    "shapely": "chart",
    "pygeomag": "chart",
    "PIL": "imaging",
    "rasterio": "raster",
    "h5py": "raster",
    "laspy": "raster",
    "pymavlink": "mavlink",
    "can": "can",
    "unicorn": "unicorn",
    "pyocd": "flash",
}
# What is a board, or measures one: real-time scheduling, pseudo terminals, /proc.
LINUX_ONLY = ("demo", "slave", "stm32", "link loopback", "board", "doctor", "bench")
UNIX = ("fcntl", "termios", "pwd")  # modules that Windows lacks
HELP = {"-h", "--help"}
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
        command, words = find_command(words)
        name = f"uuv-hil {command}" if command in COMMANDS else name
        try:
            return _dispatch(command, words)
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


def find_command(words: list[str]) -> tuple[str, list[str]]:
    """Return the name of the command that `words` begin with, and the other words.

    `help scenario check` is `scenario check --help`. A former name is replaced, and the present one is named on
    standard error. Without a command, the name is a family's, an option, or unknown; "--help" if there are no words.
    """
    if words[:1] == ["help"]:
        words = [*words[1:], "--help"]
    first, second = [*words, "", ""][:2]
    if f"{first} {second}" in COMMANDS:
        return f"{first} {second}", words[2:]
    if first in ALIASES and (first not in FAMILIES or not second or (second[0] == "-" and not {second} & HELP)):
        print(f"`uuv-hil {first}` is now `uuv-hil {ALIASES[first]}`", file=sys.stderr)
        return find_command([*ALIASES[first].split(), *words[1:]])
    return first or "--help", words[1:]


def _dispatch(name: str, arguments: list[str]) -> int:
    """Return one command's exit code, or that of --help and --version. Raises HilError, OSError."""
    if name in COMMANDS:
        return _run(name, arguments)
    if name in HELP:
        print(_help())
        return 0
    if name in ("-V", "--version"):
        from hil.common import __version__

        print(f"uuv-hil {__version__}")
        return 0
    if name in FAMILIES and (not arguments or arguments[0] in HELP):
        print(_family_help(name))
        return 0
    from hil.common.plugins import installed, load_object
    from hil.common.schema import nearest

    if name == "gateway" and (place := installed("gateways").get(arguments[0])):
        run: Callable[[list[str]], int] = load_object(place, f"gateway {arguments[0]}")
        return run(arguments[1:])
    family = FAMILIES.get(name) and f"{name} "
    word = arguments[0] if family else name
    known = members(name) if family else [one for names in GROUPS.values() for one in names]
    raise ConfigError(f"no command {(family or '') + word!r}{nearest(word, known)}; there are: {', '.join(known)}")


def members(family: str) -> list[str]:
    """Return the second words of a family's commands."""
    return [name.partition(" ")[2] for name in COMMANDS if name.startswith(f"{family} ")]


def _run(name: str, arguments: list[str]) -> int:
    """Return one command's exit code. Raises HilError, also for a missing package of an extra."""
    if {name, name.partition(" ")[0]} & set(LINUX_ONLY) and sys.platform != "linux":
        from hil.common.errors import require_linux

        require_linux(name)
    try:
        gc.disable()  # nothing that modules leave while they load is garbage
        run: Callable[[list[str]], int] = import_module(COMMANDS[name][0]).main
        gc.enable()
        lifeline.raise_on_ctrl_c()
        with every_end_like_ctrl_c():
            return run(arguments)
    except ModuleNotFoundError as error:
        if error.name in UNIX:
            raise DeviceError(f"this system has no {error.name}: the command runs on Linux and macOS") from None
        if error.name not in EXTRAS:
            raise
        family, _, member = name.partition(" ")
        is_of_gateway = family == "gateway" and error.name == "aiohttp"  # their websockets, and the view's
        extra = member if is_of_gateway else EXTRAS[error.name]
        raise MissingExtraError(f"{error.name} is not installed: pip install 'uuv-hil[{extra}]'") from None


def _help() -> str:
    from hil.common.columns import aligned, paragraph, terminal_width
    from hil.common.text import wrap_command

    width = max(len(name) for names in GROUPS.values() for name in names)
    rows = ""
    for heading, names in GROUPS.items():
        about = [(name.ljust(width), FAMILIES.get(name) or COMMANDS[name][1]) for name in names]
        rows += "\n".join(["", f"{heading}:", *aligned(about, indent="  "), ""])
    examples = "\n".join([piece for line in EXAMPLES for piece in wrap_command(line, terminal_width())])
    more = "uuv-hil COMMAND --help, or uuv-hil help COMMAND, shows each command's options, uuv-hil -V the version."
    return f"""usage: uuv-hil COMMAND [OPTIONS]

{paragraph("Hardware-in-the-loop bridge and simulator for unmanned underwater vehicles.")}
{rows}
examples:
{examples}

{paragraph(more)}

{paragraph(EXIT_CODES)}"""


def _family_help(family: str) -> str:
    from hil.common.columns import aligned, paragraph
    from hil.common.plugins import installed

    about = FAMILIES[family]
    commands = [(name, COMMANDS[f"{family} {name}"][1]) for name in members(family)]
    added = sorted(installed("gateways").items()) if family == "gateway" else []
    rows = "\n".join(aligned([*commands, *[(name, f"added by {place}") for name, place in added]], indent="  "))
    return f"""usage: uuv-hil {family} COMMAND [OPTIONS]

{paragraph(f"{about[0].upper()}{about[1:]}.")}

commands:
{rows}

{paragraph(f"uuv-hil {family} COMMAND --help shows each one's options and examples.")}

{paragraph(EXIT_CODES)}"""


if __name__ == "__main__":
    sys.exit(main())
