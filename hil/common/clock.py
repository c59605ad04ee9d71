"""Monotonic time, the rate keeper with absolute deadlines, and the setup of real-time processes.

Time is integer ns of the monotonic clock. What leaves the process is stamped with the wall clock, and follows it when
that is set: a board without a clock chip starts in the past and is set when the network comes.
"""

import gc
import os
import time
from collections import deque
from threading import Lock
from typing import NamedTuple

from hil.common.quantiles import rank

_M_ARENA_MAX = -8  # malloc.h of glibc
NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000
NS_PER_US = 1_000
NEVER_NS = 1 << 63  # later than any time

now_ns = time.monotonic_ns  # CLOCK_MONOTONIC: the same clock in every process of one machine

SET_NS = 500_000  # a larger change of the offset means that the wall clock was set; NTP slews both clocks alike


def wall_offset_ns() -> int:
    """Return the wall clock (ns since 1970) minus the monotonic clock; the reading with the shortest gap of three."""
    readings = []
    for _ in range(3):
        before = now_ns()
        wall = time.time_ns()
        after = now_ns()
        readings.append((after - before, wall - (before + after) // 2))
    return min(readings)[1]


class _Wall:
    """The present offset, read again when it seems to have changed; a pause between two readings is no change."""

    offset_ns = wall_offset_ns()

    def present_ns(self) -> int:
        if abs(time.time_ns() - now_ns() - self.offset_ns) > SET_NS:
            found = wall_offset_ns()
            if abs(found - self.offset_ns) > SET_NS:
                self.offset_ns = found
        return self.offset_ns


_wall = _Wall()


def to_wall_ns(monotonic_ns: int) -> int:
    """Return a monotonic time as ns since 1970, by the present offset between the two clocks."""
    return monotonic_ns + _wall.present_ns()


def from_wall_ns(wall_ns: int) -> int:
    """Return the inverse of `to_wall_ns`."""
    return wall_ns - _wall.present_ns()


def seconds_ns(seconds: float) -> int:
    """Return seconds as whole nanoseconds."""
    return round(seconds * NS_PER_S)


def process_start_ns() -> int:
    """Return the monotonic time (ns) at which this process was executed.

    It comes from the variable UUV_HIL_EXEC_NS if the parent has set it just before the exec, else from /proc/self/stat,
    with a resolution of one clock tick (10 ms). psutil gives the same, but would lengthen the slave's start more than
    that (hil/slave/usage.py).
    """
    value = os.environ.get("UUV_HIL_EXEC_NS", "")
    if value.isdigit():
        return int(value)
    with open("/proc/self/stat", "rb") as file:
        ticks = int(file.read().rpartition(b")")[2].split()[19])
    boot_to_monotonic = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - now_ns()
    return ticks * NS_PER_S // os.sysconf("SC_CLK_TCK") - boot_to_monotonic


def boot_id() -> str:
    """Return the identifier of this boot; processes with the same one share a clock."""
    try:
        with open("/proc/sys/kernel/random/boot_id", encoding="utf-8") as file:
            return file.read().strip()
    except FileNotFoundError:  # not Linux
        import uuid

        return f"machine {uuid.getnode():x}"


LEARN_NS = 300  # step by which the wake-up time is corrected
MAX_LEAD_NS = 100_000
MAX_FRESH = 1024  # values that a loop leaves uncounted; the slave's loop adds 400 a second


class Histogram:
    """Counts of non-negative integers in bins at most 25 % wide: constant memory, no allocation.

    A quantile is the upper edge of its bin, so it is never too small.
    """

    __slots__ = ("bins", "maximum")

    def __init__(self) -> None:
        self.bins = [0] * 256
        self.maximum = 0

    @property
    def count(self) -> int:
        """Number of values."""
        return sum(self.bins)

    def add(self, value: int) -> None:
        """Count one value; negative ones count as 0."""
        if value > self.maximum:
            self.maximum = value
        elif value < 0:
            value = 0
        shift = value.bit_length() - 3  # the first three bits choose the bin within an octave
        self.bins[value if shift <= 0 else shift * 4 + (value >> shift)] += 1

    def quantile(self, share: float) -> int:
        """Return the value that a `share` (0..1) of all values does not exceed; 0 if there are none."""
        wanted, seen = rank(share, self.count), 0
        for index, number in enumerate(self.bins):
            seen += number
            if number and seen >= wanted:
                return min(self._upper_edge(index), self.maximum)
        return self.maximum

    def share_within(self, value: int) -> float:
        """Return a lower bound of the share (0..1) of values that do not exceed `value`; 1 if there are none."""
        within = sum(number for index, number in enumerate(self.bins) if number and self._upper_edge(index) <= value)
        return 1.0 if self.maximum <= value else within / self.count

    def since(self, bins: list[int]) -> "Histogram":
        """Return the histogram of values added since its `bins` had these counts; its maximum is exact to a bin."""
        newer = Histogram()
        newer.bins = [now - before for now, before in zip(self.bins, bins, strict=True)]
        last = max((index for index, number in enumerate(newer.bins) if number), default=0)
        newer.maximum = min(self._upper_edge(last), self.maximum)
        return newer

    @staticmethod
    def _upper_edge(index: int) -> int:
        if index < 8:
            return index
        shift = index // 4 - 1
        return (((index % 4) + 5) << shift) - 1


class RateKeeper:
    """Count the periods that are due, on an absolute schedule that never drifts.

    A loop that is late catches up, but by at most `most_due` periods at once; further ones are skipped and counted in
    `skipped`.
    """

    __slots__ = (
        "_counting",
        "_fresh",
        "_lateness",
        "deadline_ns",
        "due_total",
        "lead_ns",
        "most_due",
        "period_ns",
        "skipped",
    )

    def __init__(self, period_ns: int, start_ns: int, most_due: int = 40) -> None:
        self.period_ns = period_ns
        self.deadline_ns = start_ns + period_ns
        self.most_due = most_due
        self.due_total = 0
        self.skipped = 0
        self.lead_ns = 0
        self._lateness = Histogram()
        self._fresh: deque[int] = deque()  # lateness values (ns) that are not in the histogram yet
        self._counting = Lock()

    @property
    def lateness(self) -> Histogram:
        """Histogram of how late (ns) each period was noticed. It is filled here, because the loop has no time for it.

        If this is not read for long, the loop itself adds what is more than `MAX_FRESH` values.
        """
        with self._counting:
            self._count(0)
        return self._lateness

    def timeout(self) -> float:
        """Return how long (s) to sleep: until the deadline, minus the time that a wake-up takes on this machine."""
        left = self.deadline_ns - self.lead_ns - now_ns()
        return left / NS_PER_S if left > 0 else 0.0

    def on_wakeup(self) -> int:
        """Return the monotonic time (ns) after such a sleep; after an early wake-up, wait here for the deadline.

        The wake-up time is learnt such that one in four is early: this reduces the lateness to a third, without a
        measurable increase in processor time.
        """
        now = now_ns()
        if now >= self.deadline_ns:
            self.lead_ns = min(self.lead_ns + LEARN_NS, MAX_LEAD_NS)
            return now
        if now < self.deadline_ns - MAX_LEAD_NS:  # woken by something else
            return now
        self.lead_ns = max(self.lead_ns - 3 * LEARN_NS, 0)
        while now < self.deadline_ns:
            now = now_ns()
        return now

    def due(self, now: int) -> int:
        """Return how many periods have ended by `now` (monotonic ns) since the last call."""
        late = now - self.deadline_ns
        if late < 0:
            return 0
        self._fresh.append(late)
        if len(self._fresh) > MAX_FRESH and self._counting.acquire(blocking=False):  # and no reader is counting
            self._count(MAX_FRESH)
            self._counting.release()
        if late >= self.period_ns:
            return self._catch_up(late)
        self.deadline_ns += self.period_ns
        self.due_total += 1
        return 1

    def _count(self, leave: int) -> None:
        """Add the oldest values to the histogram until only `leave` are left."""
        fresh, count = self._fresh, self._lateness.add
        while len(fresh) > leave:
            count(fresh.popleft())

    def _catch_up(self, late: int) -> int:
        number = 1 + late // self.period_ns
        for missed in range(1, min(number, self.most_due)):
            self._fresh.append(late - missed * self.period_ns)
        self.deadline_ns += number * self.period_ns
        if number > self.most_due:
            self.skipped += number - self.most_due
            number = self.most_due
        self.due_total += number
        return number


LOOP_PRIORITY = 40  # SCHED_FIFO, below the kernel's interrupt threads (50)


class RealtimeSetting(NamedTuple):
    """Result of a request for real-time behaviour: whether the system granted it, and a line for the log."""

    is_granted: bool
    text: str


def schedule_fifo(priority: int) -> RealtimeSetting:
    """Give this thread, and threads that it starts, real-time scheduling; return whether that succeeded."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        remedy = f"allow it with `ulimit -r {priority}` or CAP_SYS_NICE"
        return RealtimeSetting(False, f"scheduling: normal; SCHED_FIFO not permitted ({remedy})")
    return RealtimeSetting(True, f"scheduling: SCHED_FIFO priority {priority}")


def schedule_below_loop() -> None:
    """Make this thread real-time, with a priority just below the loop's, if the loop is real-time.

    A thread with normal scheduling that holds the interpreter lock would delay the loop for as long as other programs
    occupy the processor: seconds on a machine with a load of 25.
    """
    if os.sched_getscheduler(0) == os.SCHED_FIFO:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(LOOP_PRIORITY - 1))


_locked: set[str] = set()  # "memory" if it is locked


def lock_memory() -> RealtimeSetting:
    """Lock the process's memory into RAM; return whether that succeeded."""
    import ctypes  # 3 ms, so only here, after the process is ready

    mcl_current, mcl_future, mcl_onfault = 1, 2, 4
    libc = ctypes.CDLL(None, use_errno=True)
    # ONFAULT locks pages when they are used; without it the unused stacks of threads would become resident.
    if libc.mlockall(mcl_current | mcl_future | mcl_onfault) != 0:
        reason = os.strerror(ctypes.get_errno())
        remedy = "allow it with `ulimit -l unlimited` or CAP_IPC_LOCK"
        return RealtimeSetting(False, f"memory: not locked; mlockall: {reason} ({remedy})")
    _locked.add("memory")
    return RealtimeSetting(True, "memory: locked as it is touched")


def return_memory() -> None:
    """Return memory that was freed to the system; the allocator keeps it otherwise. Unlocks memory for that moment.

    Takes milliseconds for tens of MiB, in which another thread that allocates may wait. Only glibc can do it.
    """
    import ctypes

    libc = ctypes.CDLL(None)
    if not hasattr(libc, "malloc_trim"):
        return
    libc.munlockall()  # locked pages cannot be returned
    libc.malloc_trim(0)
    if _locked:
        lock_memory()


def use_one_arena() -> None:
    """Let all threads allocate from one arena, so that what one frees the others use. Only glibc can do it.

    Each arena keeps the memory of its longest queue so far. To be called before other threads start.
    """
    import ctypes

    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):
        libc.mallopt(_M_ARENA_MAX, 1)


_awake: list[int] = []  # open descriptors that keep the processors awake


def stay_awake() -> str:
    """Keep idle processors out of deep sleep while this process lives; return a line that says whether that succeeded.

    It uses the kernel's PM QoS. Without it a loop finds its processor asleep, with cold caches, after each pause. It
    costs power, most on PCs, whose shallowest idle state is a busy loop.
    """
    try:
        descriptor = os.open("/dev/cpu_dma_latency", os.O_WRONLY | os.O_CLOEXEC)
        os.write(descriptor, bytes(4))  # an int: the wake-up latency limit in us
    except OSError as error:
        reason = f"/dev/cpu_dma_latency: {error.strerror} (`uuv-hil board install` permits it)"
        return f"idle processors: as they are; {reason}"
    _awake.append(descriptor)
    return "idle processors: stay awake, which takes power; [slave] stay_awake = false lets them sleep"


def quiet_garbage_collector() -> str:
    """Exclude present objects from garbage collection and collect others only on request, to spare the loop pauses."""
    gc.collect()
    gc.freeze()
    gc.disable()
    return "garbage collector: off, run by the health thread"
