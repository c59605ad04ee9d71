"""Monotonic instants, the absolute-time rate keeper, and what makes a process real-time.

Time is integer nanoseconds of the monotonic clock. On the network it is the same clock shifted once,
at start, to the wall clock: two processes of one machine agree, and a wall clock that is stepped while
they run does not bend a measured delay.
"""

import gc
import os
import time
from collections import deque
from threading import Lock

from hil.common.quantiles import rank

NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000
NS_PER_US = 1_000
NEVER_NS = 1 << 63  # an instant that does not come

now_ns = time.monotonic_ns  # CLOCK_MONOTONIC: the same clock in every process of one machine

_WALL_OFFSET_NS = time.time_ns() - now_ns()


def to_wall_ns(monotonic_ns: int) -> int:
    """Return a monotonic instant as nanoseconds since 1970, by the offset the two clocks had at start."""
    return monotonic_ns + _WALL_OFFSET_NS


def from_wall_ns(wall_ns: int) -> int:
    """Return the inverse of `to_wall_ns`."""
    return wall_ns - _WALL_OFFSET_NS


def seconds_ns(seconds: float) -> int:
    """Return seconds as whole nanoseconds."""
    return round(seconds * NS_PER_S)


def process_start_ns() -> int:
    """Return the monotonic instant at which this process was executed.

    From the variable UUV_HIL_EXEC_NS when the parent set it just before the exec, else from
    /proc/self/stat, whose resolution is one clock tick (10 ms). psutil gives the same, and would cost the slave's start
    more than that (hil/slave/health/usage.py).
    """
    value = os.environ.get("UUV_HIL_EXEC_NS", "")
    if value.isdigit():
        return int(value)
    with open("/proc/self/stat", "rb") as file:
        ticks = int(file.read().rpartition(b")")[2].split()[19])
    boot_to_monotonic = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - now_ns()
    return ticks * NS_PER_S // os.sysconf("SC_CLK_TCK") - boot_to_monotonic


def boot_id() -> str:
    """Return the identifier of this boot; processes that see the same one share a clock."""
    try:
        with open("/proc/sys/kernel/random/boot_id", encoding="utf-8") as file:
            return file.read().strip()
    except FileNotFoundError:  # not Linux
        import uuid

        return f"machine {uuid.getnode():x}"


LEARN_NS = 300  # by which the time to wake up is corrected each time
MOST_LEAD_NS = 100_000
MOST_FRESH = 1024  # instants that a loop leaves uncounted, of which the slave's has 400 a second


class Histogram:
    """Counts of non-negative integers in bins at most 25 % wide: constant memory, no allocation.

    Quantiles are the upper edge of the bin they fall in, so they never flatter.
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
        """Return the value that `share` (0..1) of all values do not exceed; 0 when there are none."""
        wanted, seen = rank(share, self.count), 0
        for index, number in enumerate(self.bins):
            seen += number
            if number and seen >= wanted:
                return min(self._upper_edge(index), self.maximum)
        return self.maximum

    def share_within(self, value: int) -> float:
        """Return a share (0..1) of all values that surely does not exceed `value`; 1 when there are none."""
        within = sum(number for index, number in enumerate(self.bins) if number and self._upper_edge(index) <= value)
        return 1.0 if self.maximum <= value else within / self.count

    def since(self, bins: list[int]) -> "Histogram":
        """Return what was counted after its `bins` were these; the greatest of it is known to its bin."""
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

    A loop that comes late catches up, but not by more than `most_due` periods at once: what is beyond
    is skipped and counted in `skipped`.
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
        self._fresh: deque[int] = deque()  # lateness that the histogram has not counted yet
        self._counting = Lock()

    @property
    def lateness(self) -> Histogram:
        """Return how late each period was noticed (ns). The reader counts them: the loop has no time for it.

        Where nobody asks for long, the loop counts what is more than `MOST_FRESH`.
        """
        with self._counting:
            self._count(0)
        return self._lateness

    def timeout(self) -> float:
        """Return how long (s) to sleep now: until the deadline, less what waking up takes on this machine."""
        left = self.deadline_ns - self.lead_ns - now_ns()
        return left / NS_PER_S if left > 0 else 0.0

    def on_wakeup(self) -> int:
        """Return the instant (monotonic ns) after such a sleep; the caller, awake early, waits here.

        What waking up takes is learnt so that one in four comes early: the lateness is a third of what it was, and the
        processor time no more that can be measured.
        """
        now = now_ns()
        if now >= self.deadline_ns:
            self.lead_ns = min(self.lead_ns + LEARN_NS, MOST_LEAD_NS)
            return now
        if now < self.deadline_ns - MOST_LEAD_NS:  # something else has woken it
            return now
        self.lead_ns = max(self.lead_ns - 3 * LEARN_NS, 0)
        while now < self.deadline_ns:
            now = now_ns()
        return now

    def due(self, now: int) -> int:
        """Return how many periods have ended by `now` (monotonic ns) and not yet been reported."""
        late = now - self.deadline_ns
        if late < 0:
            return 0
        self._fresh.append(late)
        if len(self._fresh) > MOST_FRESH and self._counting.acquire(blocking=False):  # nobody is counting just now
            self._count(MOST_FRESH)
            self._counting.release()
        if late >= self.period_ns:
            return self._catch_up(late)
        self.deadline_ns += self.period_ns
        self.due_total += 1
        return 1

    def _count(self, leave: int) -> None:
        """Count the oldest, and leave so many uncounted."""
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


def schedule_fifo(priority: int) -> str:
    """Give this thread and the threads it starts real-time scheduling; return a line that says whether that worked."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return f"scheduling: normal; SCHED_FIFO not permitted (allow it with `ulimit -r {priority}` or CAP_SYS_NICE)"
    return f"scheduling: SCHED_FIFO priority {priority}"


def schedule_below_loop() -> None:
    """Let the loop preempt this thread, and nothing else that is not real-time either, if the loop is.

    A thread with normal scheduling that holds the interpreter's lock holds up the loop for as long as other programs
    keep it from the processor: on a machine with a load of 25 for seconds.
    """
    if os.sched_getscheduler(0) == os.SCHED_FIFO:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(LOOP_PRIORITY - 1))


def lock_memory() -> str:
    """Lock the process's memory into RAM; return a line that says whether that succeeded."""
    import ctypes  # 3 ms, so only here, after the process is ready

    mcl_current, mcl_future, mcl_onfault = 1, 2, 4
    libc = ctypes.CDLL(None, use_errno=True)
    # ONFAULT: lock what is touched; without it the threads' untouched stacks would become resident.
    if libc.mlockall(mcl_current | mcl_future | mcl_onfault) != 0:
        reason = os.strerror(ctypes.get_errno())
        return f"memory: not locked; mlockall: {reason} (allow it with `ulimit -l unlimited` or CAP_IPC_LOCK)"
    return "memory: locked as it is touched"


_awake: list[int] = []  # the descriptors whose being open keeps the processors awake


def stay_awake() -> str:
    """Keep idle processors out of deep sleep while this process lives; return a line that says whether that succeeded.

    By the kernel's PM QoS: without it a loop finds its processor asleep and its caches cold after each pause. It costs
    power, most on PCs, whose shallowest idle state is to spin.
    """
    try:
        descriptor = os.open("/dev/cpu_dma_latency", os.O_WRONLY | os.O_CLOEXEC)
        os.write(descriptor, bytes(4))  # an int: at most so many us to wake up
    except OSError as error:
        reason = f"/dev/cpu_dma_latency: {error.strerror} (`uuv-hil board install` permits it)"
        return f"idle processors: as they are; {reason}"
    _awake.append(descriptor)
    return "idle processors: kept awake, which takes power; [slave] stay_awake = false lets them sleep"


def quiet_garbage_collector() -> str:
    """Take the collector out of the loop's way: what is there now stays, the rest is collected on request."""
    gc.collect()
    gc.freeze()
    gc.disable()
    return "garbage collector: off, run by the health thread"
