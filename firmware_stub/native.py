"""The STM32's firmware in C as a process of this machine on a pty. It is compiled once, then cached."""

import os
from contextlib import suppress

from firmware_stub import build, mavlink_headers
from firmware_stub.child import Child
from hil.common.errors import DeviceError
from hil.common.scratch import ScratchFolder
from hil.common.tables import PROGRAM
from hil.links.wires.pty_name import PtyName
from hil.links.wires.terminal import open_pty

NAME = PROGRAM
US_PER_S = 1_000_000
MAX_PROGRAMS = 8  # in the cache, from different versions, compilers and checkouts
FOLDERS = ("include", "src", "src/native")


def cache_folder() -> str:
    """Return this user's cache folder for compiled programs."""
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return os.path.join(base, "uuv-hil")


def build_native(folder: str = "") -> str:
    """Return the path of the program in `folder` (default: the user's cache). It is compiled if it does not exist.

    Its name depends on sources and compiler, so an outdated program is never used. Without pymavlink it has no MAVLink.
    Raises DeviceError without a C compiler, or if the folder cannot be written.
    """
    folder = folder or cache_folder()
    program = os.path.join(folder, f"{NAME}-{_fingerprint()}")
    if os.access(program, os.X_OK):
        return program
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as error:
        raise DeviceError(f"{folder}: {error.strerror}; set XDG_CACHE_HOME to a folder of yours") from None
    # Renamed when complete, so that two processes may compile at the same time.
    with ScratchFolder("native", folder) as new:
        os.replace(build.compile_native(new.file(NAME), mavlink=mavlink_headers.version() is not None), program)
    _prune(folder)
    return program


def _prune(folder: str) -> None:
    """Remove all but the newest programs; a running one is not disturbed."""
    with suppress(OSError):  # another process may remove the same file
        with os.scandir(folder) as entries:
            programs = [entry for entry in entries if entry.is_file() and entry.name.startswith(f"{NAME}-")]
        for old in sorted(programs, key=lambda entry: entry.stat().st_mtime_ns)[:-MAX_PROGRAMS]:
            os.unlink(old)


class NativeStm32(Child):
    """Process of the firmware, ready on the pty `path` when this returns; stop it with `close`.

    path: the symbolic link to make, such as "/tmp/uuv-hil-stm32". channels: 1 to 16. watchdog: the longest time (s)
    without a command before all thrusters stop. Raises DeviceError with the reason if it cannot be compiled or started.
    """

    def __init__(self, path: str, channels: int, watchdog: float) -> None:
        program = build_native()
        master, slave = open_pty()
        try:
            self._name: PtyName | None = PtyName(path, os.ttyname(slave))
            try:
                super().__init__(
                    [program, os.ttyname(slave), str(channels), str(round(watchdog * US_PER_S))], stdin=master
                )
            except BaseException:
                self._name.remove()
                raise
        finally:  # the process has its own
            os.close(master)
            os.close(slave)

    def close(self) -> str:
        """Stop the process, with its outputs neutral, and remove its pty; return its final report."""
        report = super().close()
        if self._name:
            self._name.remove()
            self._name = None
        return report


def _fingerprint() -> str:
    """Return a hash that changes with every source, with the compiler, and with pymavlink."""
    import hashlib

    parts = build.native_compiler(), mavlink_headers.version(), build.fingerprint(build.sources(*FOLDERS))
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]
