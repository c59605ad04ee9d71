"""The STM32's firmware in C as a process of this machine, on a pty: compiled once, then cached."""

import os
from contextlib import suppress

from firmware_stub import build, mavlink_headers
from firmware_stub.child import Child
from hil.common.errors import DeviceError
from hil.common.scratch import ScratchFolder
from hil.common.tables import PROGRAM

NAME = PROGRAM
MOST_PROGRAMS = 8  # of other versions, compilers and checkouts
FOLDERS = ("include", "src", "src/native")


def cache_folder() -> str:
    """Return the folder of this user's compiled programs."""
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return os.path.join(base, "uuv-hil")


def build_native(folder: str = "") -> str:
    """Return the path of the program in `folder` (by default the user's cache), compiled if it is not there yet.

    Its name depends on sources and compiler, so that an outdated one is never used. Without pymavlink it has no
    MAVLink. Raises DeviceError without a C compiler, or if the folder cannot be written.
    """
    folder = folder or cache_folder()
    program = os.path.join(folder, f"{NAME}-{_fingerprint()}")
    if os.access(program, os.X_OK):
        return program
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as error:
        raise DeviceError(f"{folder}: {error.strerror}; set XDG_CACHE_HOME to a folder of yours") from None
    # Renamed when complete: two that compile at once do not disturb each other.
    with ScratchFolder("native", folder) as new:
        os.replace(build.compile_native(new.file(NAME), mavlink=mavlink_headers.version() is not None), program)
    _prune(folder)
    return program


def _prune(folder: str) -> None:
    """Remove all but the newest programs; one that runs goes on."""
    with suppress(OSError):  # another process removes the same
        with os.scandir(folder) as entries:
            programs = [entry for entry in entries if entry.is_file() and entry.name.startswith(f"{NAME}-")]
        for old in sorted(programs, key=lambda entry: entry.stat().st_mtime_ns)[:-MOST_PROGRAMS]:
            os.unlink(old)


class NativeStm32(Child):
    """Process of the firmware, ready on the pty `path` when this returns; end it with `close`.

    path: the symbolic link to make, such as "/tmp/uuv-hil-stm32". channels: 1 to 16. watchdog: the longest time
    without a command before all thrusters stop, s. Raises DeviceError if it cannot be compiled or does not start (its
    reason is in the message).
    """

    def __init__(self, path: str, channels: int, watchdog: float) -> None:
        self.path = path
        super().__init__([build_native(), "--device", path, "--channels", str(channels), "--watchdog", f"{watchdog} s"])


def _fingerprint() -> str:
    """Return a hash that changes with every source, with the compiler, and with pymavlink."""
    import hashlib

    parts = build.native_compiler(), mavlink_headers.version(), build.fingerprint(build.sources(*FOLDERS))
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]
