"""Turn SIGINT, SIGTERM and SIGHUP into a descriptor that a loop can wait on."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


def stop_signals() -> list[signal.Signals]:
    """What ends a process: also that its terminal has gone, unless whoever started it had that ignored (nohup)."""
    hung_up = getattr(signal, "SIGHUP", None)  # Windows has none
    others = [] if hung_up is None or signal.getsignal(hung_up) is signal.SIG_IGN else [hung_up]
    return [signal.SIGINT, signal.SIGTERM, *others]


@contextmanager
def every_end_like_ctrl_c() -> Iterator[None]:
    """Let whatever ends us raise KeyboardInterrupt: joblib then ends its workers, which otherwise outlive us."""
    before = {number: signal.signal(number, signal.default_int_handler) for number in stop_signals()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class StopSignals:
    """Inside the `with`, `stop_signals` only make a descriptor readable: no wait can miss one.

    The value of the `with` is that descriptor; it stays readable from the first signal on.
    """

    def __enter__(self) -> int:
        self._read_fd, self._write_fd = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._wakeup_before = signal.set_wakeup_fd(self._write_fd)
        self._before = {number: signal.signal(number, _ignore) for number in stop_signals()}
        return self._read_fd

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._wakeup_before)
        os.close(self._read_fd)
        os.close(self._write_fd)


def _ignore(_number: int, _frame: FrameType | None) -> None:
    """The interpreter has written to the descriptor already."""
