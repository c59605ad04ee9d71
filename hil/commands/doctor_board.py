"""What the doctor looks at of the board itself: clocks, heat, memory, what the kernel grants."""

from collections.abc import Iterator

from boards import model
from boards.health import governors, temperature, throttling
from boards.tree import Tree, architecture
from hil.clock import LOOP_PRIORITY
from hil.commands.doctor_case import Case, Finding

CAP_IPC_LOCK, CAP_SYS_NICE = 14, 23  # capabilities(7)
NEARLY_HOT = 5.0  # K below the temperature at which the board slows down
ACTIVE_DRIVERS = ("intel_pstate", "amd-pstate-epp")  # their "powersave" does not hold the clock down


def machine(case: Case) -> Iterator[Finding]:
    """What this is, and its free memory."""
    board, told = case.board, model(case.tree.root)
    kind = architecture(case.tree) or "unknown architecture"
    text = f"{board.name}, {board.cpu}" if board else f"none of those known; {told or kind}"
    yield Finding("ok", "board", text + (f' ("{told}")' if board and told else ""))
    for line in case.tree.text("/proc/meminfo").splitlines() if board else ():
        name, _, value = line.partition(":")
        if name == "MemAvailable" and board and int(value.split()[0]) / 1024 < board.recommended.memory:
            few = f"{int(value.split()[0]) / 1024:.0f} MiB free, the slave may take {board.recommended.memory:g}"
            yield Finding(case.severity, "memory free", few, "end other programs; see: ps aux --sort -rss | head")


def rates(case: Case) -> Iterator[Finding]:
    """Whether the scenario asks more of the board than is recommended."""
    if case.scenario and case.board:
        asked, good = case.scenario.slave.step, case.board.recommended.step
        if asked < good * 0.999:
            text = f"a step of {asked * 1e3:g} ms is shorter than the {good * 1e3:g} ms recommended for this board"
            yield Finding("note", "step", text, f'[slave] step = "{good * 1e3:g} ms", or measure it here')


def governor(case: Case) -> Iterator[Finding]:
    """How the processor's clock is governed: one that wakes up slowly makes the loop late."""
    found = governors(case.tree)
    if not found:
        return
    text = ", ".join(f"{name} on {count} processors" for name, count in found.items())
    active = case.tree.text("/sys/devices/system/cpu/cpu0/cpufreq/scaling_driver") in ACTIVE_DRIVERS
    if set(found) == {"performance"} or (active and set(found) <= {"performance", "powersave"}):
        yield Finding("ok", "governor", text)
        return
    slow = "powersave" in found
    remedy = "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor (it takes more power)"
    meaning = "the clock stays at its lowest" if slow else "the clock follows the load, late"
    yield Finding(case.severity if slow else "note", "governor", f"{text}: {meaning}", remedy)


def throttled(case: Case) -> Iterator[Finding]:
    """Whether heat or the power supply slows the processor down."""
    slow, warmth = throttling(case.tree, case.board), temperature(case.tree, case.board)
    supply = "a power supply and cable for the board's full current; nothing that draws much on its USB"
    remedy = {True: supply, False: "a heat sink, a fan, or a lower load"}
    for text in slow.now:
        yield Finding(case.severity, "throttled", f"now: {text}", remedy["voltage" in text])
    for text in slow.before:
        if text not in slow.now:
            yield Finding("note", "throttled", f"since boot: {text}", remedy["voltage" in text])
    if warmth is None:
        return
    limit = case.board.throttles_at if case.board else 0.0
    hot = bool(limit) and warmth > limit - NEARLY_HOT
    text = f"{warmth:.1f} °C" + (f", slows down from {limit:g} °C" if limit else "")
    yield Finding("note" if hot else "ok", "temperature", text, remedy[False] if hot else "")


def realtime_limits(case: Case) -> Iterator[Finding]:
    """Whether real-time scheduling and locked memory are granted, by the limits and capabilities of this process."""
    tree = case.tree
    if case.scenario and not case.scenario.slave.realtime:
        yield Finding("ok", "real time", "not wanted by the scenario")
        return
    limits, capabilities = process_limits(tree), _capabilities(tree)
    remedy = "uuv-hil board install grants it to the service and its user; for this shell: see /etc/security/limits.d"
    priority, memory = limits.get("Max realtime priority"), limits.get("Max locked memory")
    if tree.text("/proc/sys/kernel/sched_rt_runtime_us") == "0":
        text = "the kernel grants no time to SCHED_FIFO: sched_rt_runtime_us is 0"
        yield Finding(case.severity, "real time", text, "sudo sysctl kernel.sched_rt_runtime_us=950000")
    if priority is not None and not capabilities >> CAP_SYS_NICE & 1:
        enough = priority >= LOOP_PRIORITY
        text = f"priority {priority:g} is permitted, the slave's loop wants {LOOP_PRIORITY}"
        yield Finding("ok" if enough else case.severity, "real time", text, "" if enough else remedy)
    if memory is not None and not capabilities >> CAP_IPC_LOCK & 1:
        enough = memory >= 128 * 2**20
        text = "unlimited" if memory == float("inf") else f"{memory / 2**20:g} MiB"
        yield Finding("ok" if enough else "note", "lock limit", f"{text} may be locked", "" if enough else remedy)


def clock(case: Case) -> Iterator[Finding]:
    """Whether the clock is kept right by others."""
    answer = case.tree.run("timedatectl", "show", "--property=NTPSynchronized", "--value")
    if answer == "yes":
        yield Finding("ok", "clock", "synchronised")
    elif answer == "no":
        text = "not synchronised: dates of recordings and certificates, and delays between machines, mean nothing"
        remedy = "sudo timedatectl set-ntp true; without internet, chrony with the master's computer as its server"
        yield Finding(case.severity if case.remote else "note", "clock", text, remedy)
    else:
        yield Finding("note", "clock", "whether it is synchronised cannot be told: no answer of timedatectl")


def process_limits(tree: Tree) -> dict[str, float]:
    """Name -> soft limit of this process, as /proc/self/limits has it."""
    found = {}
    for line in tree.text("/proc/self/limits").splitlines()[1:]:
        name, value = line[:26].strip(), line[26:].split()
        if value:
            found[name] = float("inf") if value[0] == "unlimited" else float(value[0])
    return found


def _capabilities(tree: Tree) -> int:
    for line in tree.text("/proc/self/status").splitlines():
        if line.startswith("CapEff:"):
            return int(line.split()[1], 16)
    return 0
