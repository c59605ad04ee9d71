"""Identity of a machine's boot, and checks of its system and of a package's bytecode."""

import os
import sys

from hil.common.errors import DeviceError

ELSEWHERE = "on this system run sim, master, view, topic, the gateways, and what needs no board"


def require_linux(what: str) -> None:
    """Raise DeviceError, in one line, on a system that cannot do `what`."""
    if sys.platform != "linux":
        raise DeviceError(f"{what} runs on Linux only, and this is {sys.platform}; {ELSEWHERE}")


def boot_id() -> str:
    """Return the identifier of this boot; processes that see the same one share a clock."""
    try:
        with open("/proc/sys/kernel/random/boot_id", encoding="utf-8") as file:
            return file.read().strip()
    except FileNotFoundError:  # not Linux
        import uuid

        return f"machine {uuid.getnode():x}"


def bytecode_compiled(package: str) -> bool:
    """Return whether every loaded module came from compiled bytecode on disk, or from C."""
    modules = [m for name, m in sys.modules.items() if name == package or name.startswith(package + ".")]
    python = [module for module in modules if not (getattr(module, "__file__", None) or "").endswith(".so")]
    cached = [getattr(module, "__cached__", None) for module in python]
    return bool(cached) and all(path is not None and os.path.exists(path) for path in cached)
