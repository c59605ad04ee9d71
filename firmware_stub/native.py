"""The STM32's firmware in C as a process of this machine, on a pty: compiled once, then found again."""

import os

from firmware_stub import build, mavlink_headers
from firmware_stub.child import Child
from hil.errors import DeviceError

NAME = "uuv-hil-stm32-native"
FOLDERS = ("include", "src", "src/native")


def cache_folder() -> str:
    """Where compiled programs of this user are kept."""
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return os.path.join(base, "uuv-hil")


def build_native(folder: str = "") -> str:
    """The path of the program in `folder` (by default the user's cache), compiled if it is not there yet.

    Its name tells sources and compiler apart, so that an old one is never taken. Without pymavlink it knows no
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
    new = f"{program}.{os.getpid()}"
    os.replace(build.compile_native(new, mavlink=mavlink_headers.version() is not None), program)
    return program


class NativeStm32(Child):
    """The process, serving on the pty `path` when this returns; end it with `close`.

    path: the symbolic link to make, such as "/tmp/uuv-hil-stm32". channels: 1 to 16. watchdog: the longest silence
    before all thrusters stop, s. Raises DeviceError if it cannot be compiled or does not come up (its reason is in
    the message).
    """

    def __init__(self, path: str, channels: int, watchdog: float) -> None:
        self.path = path
        super().__init__([build_native(), "--device", path, "--channels", str(channels), "--watchdog", f"{watchdog} s"])


def _fingerprint() -> str:
    """Changes with every source, with the compiler, and with pymavlink."""
    import hashlib

    parts = build.native_compiler(), mavlink_headers.version(), build.fingerprint(build.sources(*FOLDERS))
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]
