"""Notify systemd that the slave is ready and alive: sd_notify(3) without its library.

Without systemd, that is without NOTIFY_SOCKET in the environment, `notify` does nothing and imports nothing.
"""

import os


def notify(state: str) -> bool:
    """Send one state, as "READY=1"; return whether it was sent. Never raises."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if address[:1] not in ("/", "@"):
        return False
    import socket

    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as wire:
            # "@" stands for the zero byte that begins the name of an abstract socket; see unix(7).
            wire.sendto(state.encode(), address.replace("@", "\0", 1) if address[0] == "@" else address)
    except OSError:
        return False
    return True


class Heartbeat:
    """Feed systemd's watchdog while the loop advances; if the loop hangs, the watchdog expires."""

    __slots__ = ("_last_progress",)

    def __init__(self) -> None:
        self._last_progress = -1

    def beat(self, progress: int) -> None:
        """Notify systemd if `progress`, any number that changes while the loop runs, has changed."""
        if progress != self._last_progress:
            self._last_progress = progress
            notify("WATCHDOG=1")
