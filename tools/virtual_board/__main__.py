"""Run this project's wheel on a virtual single-board computer: emulated 64-bit Arm, with this machine as its network.

    python -m tools.virtual_board build --package numpy
    python -m tools.virtual_board run -- slave paper_field
    python -m tools.virtual_board run -- bench startup --repeat 3
    python -m tools.virtual_board python -- -c 'import platform; print(platform.machine())'
    python -m tools.virtual_board boot --port 7447:7447 -- 'ip link; uuv-hil doctor'

`build` makes a Debian root for arm64 (debootstrap fetches and checks the packages; they are unpacked, never run as
root), builds the wheel with a cross compiler and installs it with its dependencies' arm64 wheels. `bench startup` also
needs numpy, a slave does not.

`run` and `python` execute another processor's instructions on this kernel: a program's arithmetic and packaging. From
within they can start the board's Python again, but no other arm64 program. `boot` emulates a whole machine: kernel,
systemd, two CAN controllers on one bus and vcan, a network that reaches this machine. It shows that the project works
there. It does not show a board's speed, and its measurements are labelled as emulated: pure Python takes about 9 times
as long as on this machine with `run`, 25 times with `boot`.

Needs: apt install debootstrap qemu-user qemu-system-arm cpio gcc-aarch64-linux-gnu libc6-dev-arm64-cross, and root.
"""

import argparse
import os
import sys
from collections.abc import Mapping
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent.parent))

from hil.common.errors import DeviceError
from hil.common.stop import every_end_like_ctrl_c
from tools.virtual_board.board import VirtualBoard
from tools.virtual_board.system import Booted


def main() -> int:
    """Build the board, or run a job on it; return the exit code."""
    options = parse(sys.argv[1:])
    try:
        with every_end_like_ctrl_c():
            return _do(options)
    except DeviceError as error:
        print(f"virtual_board: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return 130


def _do(options: argparse.Namespace) -> int:
    board = VirtualBoard(options.folder)
    if options.verb == "build":
        print(f"building in {board.folder}; the first time takes a minute", flush=True)
        board.build(options.package)
        return 0
    if options.verb == "boot":
        with Booted(board, " ".join(options.arguments), _ports(options.port), print) as booted:
            return booted.wait(float("inf"))
    words = ["-m", "hil.cli", *options.arguments] if options.verb == "run" else options.arguments
    command = board.command(*words)
    return os.execvp(command[0], command)


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the options. Words after -- are removed first, because argparse mixes them up with options before it."""
    end = arguments.index("--") if "--" in arguments else len(arguments)
    parser = argparse.ArgumentParser(
        prog="python -m tools.virtual_board", usage="%(prog)s VERB [options] [-- WORD ...]", description=__doc__,
        epilog="After -- come the arguments of uuv-hil (run), of Python (python), or a shell command (boot).",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("verb", metavar="VERB", choices=("build", "run", "python", "boot"), help="%(choices)s")
    parser.add_argument("--folder", default="", help="where the board is [in the user's cache]")
    parser.add_argument("--package", action="append", default=[], help="build: another package, such as numpy")
    parser.add_argument("--port", action="append", default=[], metavar="HERE:THERE", help="boot: forward a TCP port")
    options = parser.parse_args(arguments[:end], argparse.Namespace(arguments=arguments[end + 1 :]))
    if options.verb == "boot" and not options.arguments:
        parser.error("boot needs a job after --, such as -- 'ip link'")
    return options


def _ports(texts: list[str]) -> Mapping[int, int]:
    try:
        return {int(here): int(there) for here, there in (text.split(":") for text in texts)}
    except ValueError:
        raise DeviceError(f"--port {' '.join(texts)}: expected HERE:THERE, such as 7447:7447") from None


if __name__ == "__main__":
    sys.exit(main())
