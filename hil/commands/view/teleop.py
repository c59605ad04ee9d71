"""`uuv-hil teleop`: steer a vehicle from a terminal, by keys or with a gamepad."""

import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager

import hil
from hil.client import services
from hil.client.vehicle_handle import Vehicle
from hil.commands.listening import add_fleet, add_take_over, connect_arguments
from hil.common.clock import now_ns
from hil.common.errors import ConfigError, HilError
from hil.common.options import new_parser
from hil.common.stop import StopSignals
from hil.common.streams import ProgressLine
from hil.view.teleop.gamepad import Gamepad
from hil.view.teleop.keys import HELP, Keys
from hil.view.teleop.steering import PERIOD_S, Steering

EXAMPLES = f"""\
{HELP}.
The vehicle moves while a key repeats. With --gamepad it moves while a shoulder button is held; left stick ahead and
turn, right stick up, down and sideways. Depth and heading are held while nothing changes them.

examples:
  uuv-hil teleop
  uuv-hil teleop --connect tcp/192.168.3.116:7447 --gamepad
"""


def main(arguments: list[str]) -> int:
    """Steer until Ctrl-C; return the exit code."""
    parser = new_parser("teleop", __doc__, EXAMPLES)
    add_fleet(parser)
    parser.add_argument("--vehicle", metavar="NAME", help="vehicle to steer [the first]")
    parser.add_argument("--gamepad", action="store_true", help="steer with the first gamepad of this machine")
    add_take_over(parser)
    options = parser.parse_args(arguments)
    _, (endpoints, routed, keys) = connect_arguments(options)
    pad = Gamepad() if options.gamepad else None
    with (
        StopSignals() as stop_fd,
        hil.connect(*endpoints, routed=routed, keys=keys, take_over=options.take_over) as fleet,
    ):
        vehicle = fleet[options.vehicle] if options.vehicle else next(iter(fleet))
        print(f"{vehicle.name}, steered by {pad.name if pad else 'keys'}: {HELP}", flush=True)
        with _raw_terminal() as keyboard_fd, Steering(vehicle, lambda _: None) as steering:
            _steer(vehicle, steering, pad, keyboard_fd, stop_fd)
    return 0


def _steer(vehicle: Vehicle, steering: Steering, pad: Gamepad | None, keyboard_fd: int, stop_fd: int) -> None:
    keys, line, message = Keys(), ProgressLine(), ""
    while True:
        ready = select.select((keyboard_fd, stop_fd), (), (), PERIOD_S)[0]
        if stop_fd in ready:
            break
        if keyboard_fd in ready:
            typed = os.read(keyboard_fd, 64).decode(errors="ignore")
            if not typed:  # the terminal was closed
                break
            for key in typed:
                message = _act(vehicle, key) or message
                keys.press(key, now_ns())
        reason = steering.update(0, pad.message() if pad else keys.message(now_ns()))
        line.show(f"{_state(vehicle)}  {(pad.problem if pad else '') or reason or message}")
    line.clear()


def _act(vehicle: Vehicle, key: str) -> str:
    """Disarm or arm by a key; return the result as text, "" for other keys."""
    if key not in "xv":
        return ""
    try:
        return services.arm(vehicle, key == "v")
    except HilError as error:
        return str(error)


def _state(vehicle: Vehicle) -> str:
    try:
        state = vehicle.state
    except HilError as error:
        return str(error)
    north, east, depth = state.position
    return f"N {north:.1f} E {east:.1f} depth {depth:.2f} m, {state.speed:.2f} m/s"


@contextmanager
def _raw_terminal() -> Iterator[int]:
    """Provide keys one by one, without echo; Ctrl-C stays a signal. Raises ConfigError without a terminal."""
    number = sys.stdin.fileno()
    if not os.isatty(number):
        raise ConfigError("teleop reads keys from a terminal; standard input is not a terminal")
    before = termios.tcgetattr(number)
    tty.setcbreak(number)
    try:
        yield number
    finally:
        termios.tcsetattr(number, termios.TCSADRAIN, before)
