"""Options of every command that opens a thruster link at an address."""

import argparse

from hil.common.options import BAUD, BITRATE, integer
from hil.links.address import FORMS
from hil.links.contract import MAX_THRUSTERS


def add_link(parser: argparse.ArgumentParser, port: str | None) -> None:
    """Add address, protocol and speed of a link, and its number of thrusters. `port` is the default address."""
    add = parser.add_argument
    add("--port", default=port, metavar="ADDRESS", help=FORMS + (f" [{port}]" if port else ""))
    add("--protocol", metavar="NAME", default="frame", help="frame, mavlink, dronecan or vesc [%(default)s]")
    add(
        "--frame",
        metavar="NAME|FILE",
        default="uuv_hil",
        help="name of a frame, or path of a frame's TOML file [%(default)s]",
    )
    add("--option", action="append", default=[], metavar="NAME=VALUE", help="a setting of the protocol")
    add("--baud", metavar="BIT/S", type=BAUD, default=115_200, help="speed of a serial device, bit/s [%(default)s]")
    add(
        "--bitrate",
        metavar="BIT/S",
        type=BITRATE,
        default=1_000_000,
        help="speed of a CAN bus that this program sets up, bit/s [%(default)s]",
    )
    add(
        "--channels",
        type=integer(1, MAX_THRUSTERS),
        default=6,
        metavar="N",
        help="number of thrusters [%(default)s]",
    )
