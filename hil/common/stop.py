"""Descriptors for a loop to wait on: for signals that end the process, and for events in other threads."""

import os
import select
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from types import FrameType

_ROOM = 4096  # bytes read at a time


def stop_signals() -> list[signal.Signals]:
    """Return the signals that end a process; SIGHUP only if the parent did not ignore it, as nohup does."""
    hung_up = getattr(signal, "SIGHUP", None)  # Windows has no SIGHUP
    others = [] if hung_up is None or signal.getsignal(hung_up) is signal.SIG_IGN else [hung_up]
    return [signal.SIGINT, signal.SIGTERM, *others]


@contextmanager
def every_end_like_ctrl_c() -> Iterator[None]:
    """Raise KeyboardInterrupt on every signal that ends us and that the parent did not ignore.

    What a command does at its end, as writing its results or ending joblib's workers, does not depend on the signal.
    """
    ending = [number for number in stop_signals() if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, _interrupt) for number in ending}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, and print no errors of other threads: joblib's has one when its workers are killed."""
    import threading

    threading.excepthook = lambda _: None
    raise KeyboardInterrupt


@contextmanager
def ctrl_c_held_back() -> Iterator[None]:
    """Delay Ctrl-C until after the `with`; processes that are started inside it never get it.

    A terminal sends Ctrl-C to every process of the command, even to one that is still loading its modules.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


async def cancel_tasks() -> None:
    """Cancel the other tasks of this event loop, such as those of clients still connected, and wait for their end."""
    import asyncio  # only here: it would cost a slave's start 60 ms

    rest = asyncio.all_tasks() - {asyncio.current_task()}
    for task in rest:
        task.cancel()
    await asyncio.gather(*rest, return_exceptions=True)


class Wakeup:
    """A descriptor that `set` makes readable, from any thread, until `clear`.

    It is a non-blocking pipe. Windows, whose select() accepts only sockets, and macOS use a pair of sockets instead.
    """

    def __init__(self) -> None:
        self._write: Callable[[bytes], int]
        self._read: Callable[[int], bytes]
        if hasattr(os, "pipe2"):
            self._fds = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
            self._read, self._write = partial(os.read, self._fds[0]), partial(os.write, self._fds[1])
            self._close: list[Callable[[], None]] = [partial(os.close, fd) for fd in self._fds]
        else:
            import socket  # only here: it would cost a slave's start 5 ms

            ends = socket.socketpair()
            for end in ends:
                end.setblocking(False)
            self._fds = (ends[0].fileno(), ends[1].fileno())
            self._read, self._write = ends[0].recv, ends[1].send
            self._close = [end.close for end in ends]

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self._fds[0]

    def writer(self) -> int:
        """Return the descriptor to write to; each byte does what `set` does."""
        return self._fds[1]

    def set(self) -> None:
        """Make the descriptor readable."""
        with suppress(BlockingIOError):  # full, so already readable
            self._write(b"\0")

    def clear(self) -> None:
        """Make the descriptor not readable."""
        with suppress(BlockingIOError):
            while len(self._read(_ROOM)) == _ROOM:
                pass

    def close(self) -> None:
        """Close both ends. `set` raises OSError after that."""
        for close in self._close:
            close()


class StopSignals:
    """Inside the `with`, signals of `stop_signals` only make a descriptor readable, so that no wait can miss one.

    The value of the `with` is this descriptor; it stays readable after the first signal.
    """

    def __enter__(self) -> int:
        self._wakeup = Wakeup()
        self._wakeup_before = signal.set_wakeup_fd(self._wakeup.writer())
        self._before = {number: signal.signal(number, _ignore) for number in stop_signals()}
        return self._wakeup.fileno()

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._wakeup_before)
        self._wakeup.close()


def is_stopped(stop_fd: int, seconds: float) -> bool:
    """Wait for so long; return at once, and True, when a signal of `StopSignals` has come."""
    return bool(select.select((stop_fd,), (), (), seconds)[0])


def pause(stop_fd: int, seconds: float) -> None:
    """Wait for so long. Raises KeyboardInterrupt at once when a signal of `StopSignals` has come."""
    if is_stopped(stop_fd, seconds):
        raise KeyboardInterrupt


def _ignore(_number: int, _frame: FrameType | None) -> None:
    """Do nothing: the interpreter has written to the descriptor already."""
