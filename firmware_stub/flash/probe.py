"""Write an image with a debug probe: ST-LINK (every Nucleo has one), CMSIS-DAP, J-Link; by pyOCD (extra `flash`).

pyOCD's errors are raised as DeviceError. Without pyOCD the functions raise ModuleNotFoundError.
"""

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from firmware_stub.flash.content import Content
from hil.common.errors import DeviceError

DEVICE_ID_REGISTER, DEVICE_ID_MASK = 0xE004_2000, 0xFFF  # DBGMCU_IDCODE
# pyOCD must not read configuration files of the current folder, and must not print.
OPTIONS = {"no_config": True, "hide_programming_progress": True, "smart_flash": False, "frequency": 1_000_000}
NO_PROBE = (
    "no debug probe found: connect an ST-LINK, CMSIS-DAP or J-Link by USB (a Nucleo has its own); if one is connected, "
    "this user may not open it: see https://pyocd.io/docs/installing for udev rules. Without a probe: --by dfu"
)


class Probe(NamedTuple):
    """A connected debug probe: its unique id, its name, and pyOCD's object.

    under_reset: whether it holds the chip in reset while it connects.
    """

    unique_id: str
    name: str
    handle: Any
    under_reset: bool = False


class Board(NamedTuple):
    """The board at a probe: its name, if the probe knows it, and the device id of its chip."""

    name: str
    device_id: int


def find_probe(unique_id: str | None) -> Probe:
    """Return the only probe, or the one whose unique id contains `unique_id`.

    Raises DeviceError if there is none, or if several match.
    """
    from pyocd.core.helpers import ConnectHelper

    logging.getLogger("pyocd").setLevel(logging.CRITICAL)  # it also raises what it logs
    with _errors("the debug probes cannot be listed"):
        found = ConnectHelper.get_all_connected_probes(blocking=False, print_wait_message=False)
    probes = [Probe(handle.unique_id, handle.description, handle) for handle in found]
    if not probes:
        raise DeviceError(NO_PROBE)
    chosen = [probe for probe in probes if unique_id is None or unique_id.lower() in probe.unique_id.lower()]
    listed = "; ".join(f"{probe.unique_id} ({probe.name})" for probe in probes)
    if not chosen:
        raise DeviceError(f"no debug probe with {unique_id!r} in its number; there are: {listed}")
    if len(chosen) > 1:
        raise DeviceError(f"{len(chosen)} debug probes: choose one with --probe NUMBER, of: {listed}")
    return chosen[0]


def identify(probe: Probe) -> Board:
    """Return the board at a probe. Its program continues afterwards. Raises DeviceError if no chip answers."""
    with _session(probe, "cortex_m") as session:
        info = probe.handle.associated_board_info
        word = session.target.read32(DEVICE_ID_REGISTER)
    return Board(info.name if info else "", word & DEVICE_ID_MASK)


def write(probe: Probe, content: Content, report: Callable[[str], None]) -> None:
    """Erase the needed sectors, write the content, verify it, and start the program.

    The chip must be that of the image. Raises DeviceError if a step fails, or the flash has different bytes afterwards.
    """
    from pyocd.flash.loader import FlashLoader

    from firmware_stub.flash import pyocd_targets

    pyocd_targets.register()
    with _session(probe, pyocd_targets.PREFIX + content.image.name) as session:
        target = session.target
        target.reset_and_halt()  # otherwise the program's watchdog would reset the chip during the write
        loader = FlashLoader(session, chip_erase="sector")
        for address, data in content.pieces:
            loader.add_data(address, data)
        loader.commit()
        for address, data in content.pieces:
            if bytes(target.read_memory_block8(address, len(data))) != data:
                raise DeviceError(
                    f"the flash at {address:#010x} has other bytes than were written: worn out, or a clone"
                )
            report(f"{len(data)} bytes at {address:#010x} written and compared")
        target.reset()


@contextmanager
def _session(probe: Probe, target: str) -> Iterator[Any]:
    """Return an open session of pyOCD."""
    from pyocd.core.session import Session

    hint = "" if probe.under_reset else ", or try --under-reset"
    what = f"{probe.name} {probe.unique_id}: failed: check SWDIO, SWCLK, GND and the chip's supply{hint}"
    mode = "under-reset" if probe.under_reset else "halt"
    options = OPTIONS | {"target_override": target, "connect_mode": mode}
    with _errors(what), Session(probe.handle, options=options) as session:
        yield session


@contextmanager
def _errors(what: str) -> Iterator[None]:
    """Raise pyOCD's and USB's errors as DeviceError."""
    from pyocd.core.exceptions import Error

    try:
        yield
    except (Error, OSError) as error:
        raise DeviceError(f"{what} ({error})") from None
