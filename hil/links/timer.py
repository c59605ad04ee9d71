"""A descriptor that wakes a waiting loop at an instant."""

import os
from struct import Struct
from time import CLOCK_MONOTONIC

from hil.clock import NS_PER_S
from hil.errors import DeviceError

NEVER_NS = 1 << 63


class Timer:
    """A descriptor that becomes readable at an instant: Linux's timerfd, which Python 3.11 does not have."""

    SPEC = Struct("4l")  # struct itimerspec: interval s, ns; value s, ns
    ABSOLUTE = 1  # TFD_TIMER_ABSTIME, sys/timerfd.h

    def __init__(self) -> None:
        import ctypes  # only who asks for faults pays for it

        self._libc = ctypes.CDLL(None, use_errno=True)
        self.fd: int = self._libc.timerfd_create(CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC)
        if self.fd < 0:
            raise DeviceError(f"timerfd: {os.strerror(ctypes.get_errno())}; raise the limit of open files: ulimit -n")
        self._armed_ns = NEVER_NS

    def arm(self, at_ns: int) -> None:
        """Become readable at `at_ns` (monotonic) and stay so until armed anew; `NEVER_NS`: never."""
        if at_ns == self._armed_ns:
            return
        self._armed_ns = at_ns
        seconds, rest = (0, 0) if at_ns == NEVER_NS else divmod(max(1, at_ns), NS_PER_S)
        self._libc.timerfd_settime(self.fd, self.ABSOLUTE, self.SPEC.pack(0, 0, seconds, rest), None)

    def close(self) -> None:
        """Give the descriptor back."""
        os.close(self.fd)
