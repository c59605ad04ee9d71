"""A descriptor that wakes a waiting loop at a set time."""

import os
import time
from struct import Struct

from hil.common.clock import NEVER_NS, NS_PER_S, NS_PER_US
from hil.common.errors import DeviceError


class Timer:
    """A descriptor that becomes readable at about a set time: Linux's timerfd, which Python has since 3.13.

    A process wakes some 50 to 150 us after its timer. `lead_ns` is this latency, learned from each wake-up, and the
    timer is set earlier by it: half of the wake-ups come before the set time, half after.
    """

    SPEC = Struct("4l")  # struct itimerspec: interval s, ns; value s, ns
    ABSOLUTE = 1  # TFD_TIMER_ABSTIME, sys/timerfd.h
    LEARN_NS = 2 * NS_PER_US  # step towards the median, which rare long delays do not change much
    MAX_LEAD_NS = 200 * NS_PER_US

    def __init__(self) -> None:
        import ctypes  # loaded for links with faults only

        self._libc = ctypes.CDLL(None, use_errno=True)
        self.fd: int = self._libc.timerfd_create(time.CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC)
        if self.fd < 0:
            raise DeviceError(f"timerfd: {os.strerror(ctypes.get_errno())}; raise the limit of open files: ulimit -n")
        self.lead_ns = 50 * NS_PER_US
        self._wanted_ns = NEVER_NS
        self._set_ns = NEVER_NS

    def arm(self, at_ns: int) -> None:
        """Make the timer readable from about `at_ns` (monotonic) on, until it is set again; `NEVER_NS`: never."""
        if at_ns == self._wanted_ns:
            return
        self._wanted_ns = at_ns
        self._set_ns = at_ns if at_ns == NEVER_NS else max(1, at_ns - self.lead_ns)
        seconds, rest = (0, 0) if at_ns == NEVER_NS else divmod(self._set_ns, NS_PER_S)
        self._libc.timerfd_settime(self.fd, self.ABSOLUTE, self.SPEC.pack(0, 0, seconds, rest), None)

    def horizon(self, now: int) -> int:
        """Return the time up to which data count as due, after a wake-up at `now` (both monotonic ns)."""
        if now >= self._set_ns:
            late = now - self._set_ns > self.lead_ns
            lead_ns = self.lead_ns + (self.LEARN_NS if late else -self.LEARN_NS)
            self.lead_ns = min(max(lead_ns, 0), self.MAX_LEAD_NS)
            return max(now, self._wanted_ns)
        return now

    def close(self) -> None:
        """Close the descriptor."""
        os.close(self.fd)
