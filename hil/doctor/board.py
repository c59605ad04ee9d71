"""Check the board: clocks, temperature, memory, and whether the kernel schedules in real time."""

from collections.abc import Iterator

from boards import model
from boards.health import governors, temperature, throttling
from boards.resources import available_memory_mib
from boards.tree import architecture
from hil.doctor.findings import Case, Finding

NEARLY_HOT = 5.0  # K below the temperature at which the board throttles
CGROUPS = "/sys/fs/cgroup"
MEMORY_REMEDY = (
    "take cgroup_disable=memory out of the kernel's command line; on a Raspberry Pi, add cgroup_enable=memory to the "
    "line in /boot/firmware/cmdline.txt; and reboot"
)
ACTIVE_DRIVERS = ("intel_pstate", "amd-pstate-epp")  # with these drivers "powersave" does not limit the clock


def check_machine(case: Case) -> Iterator[Finding]:
    """Report the machine's model, and check its available memory."""
    board, model_name = case.board, model(case.tree.root)
    kind = architecture(case.tree) or "unknown architecture"
    text = f"{board.name}, {board.cpu}" if board else f"not a known board: {model_name or kind}"
    yield Finding("ok", "board", text + (f' ("{model_name}")' if board and model_name else ""))
    free = available_memory_mib(case.tree)
    if board and free is not None and free < board.recommended.memory:
        text = f"{free:.0f} MiB free, but the slave may need {board.recommended.memory:g}"
        yield Finding(case.severity, "memory free", text, "end other programs; see: ps aux --sort -rss | head")


def check_memory_limit(case: Case) -> Iterator[Finding]:
    """Check whether the kernel can enforce MemoryMax of the service. Otherwise a leak may end other programs."""
    tree, is_enabled = case.tree, True
    if tree.exists(f"{CGROUPS}/cgroup.controllers"):
        is_enabled = "memory" in tree.text(f"{CGROUPS}/cgroup.controllers").split()
    elif not tree.exists(f"{CGROUPS}/memory"):  # cgroups version 1
        words = tree.text("/proc/cmdline").split()
        is_enabled = "cgroup_disable=memory" not in words or "cgroup_enable=memory" in words
    if not is_enabled:
        text = "the kernel's memory controller is off: MemoryMax= of the service has no effect"
        yield Finding("note", "memory limit", text, MEMORY_REMEDY)


def check_step_period(case: Case) -> Iterator[Finding]:
    """Check whether the scenario's step is shorter than recommended for the board."""
    if case.scenario and case.board:
        step, recommended = case.scenario.slave.step, case.board.recommended.step
        if step < recommended * 0.999:
            text = (
                f"a step of {step * 1e3:g} ms is shorter than the {recommended * 1e3:g} ms recommended for this board"
            )
            yield Finding(
                "note",
                "step",
                text,
                f'[slave] step = "{recommended * 1e3:g} ms", or see the step cost that doctor measures on the board',
            )


def check_governor(case: Case) -> Iterator[Finding]:
    """Check the frequency governor, because the loop is late while the clock rises slowly."""
    counts = governors(case.tree)
    if not counts:
        return
    text = ", ".join(f"{name} on {count} processors" for name, count in counts.items())
    active = case.tree.text("/sys/devices/system/cpu/cpu0/cpufreq/scaling_driver") in ACTIVE_DRIVERS
    if set(counts) == {"performance"} or (active and set(counts) <= {"performance", "powersave"}):
        yield Finding("ok", "governor", text)
        return
    is_slowest = "powersave" in counts
    remedy = "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor (uses more power)"
    meaning = "the clock stays at its lowest" if is_slowest else "the clock follows the load with a delay"
    yield Finding(case.severity if is_slowest else "note", "governor", f"{text}: {meaning}", remedy)


def check_throttling(case: Case) -> Iterator[Finding]:
    """Check whether the processor is throttled by heat or the power supply."""
    reasons, celsius = throttling(case.tree, case.board), temperature(case.tree, case.board)
    supply = "use a power supply and cable for the board's full current; connect no USB device that draws much"
    remedy = {True: supply, False: "add a heat sink or a fan, or reduce the load"}
    for text in reasons.now:
        yield Finding(case.severity, "throttled", f"now: {text}", remedy["voltage" in text])
    for text in reasons.before:
        if text not in reasons.now:
            yield Finding("note", "throttled", f"since boot: {text}", remedy["voltage" in text])
    if not reasons.known and case.board and case.board.throttling == "vcgencmd":
        text = "throttling cannot be determined: the firmware does not answer vcgencmd"
        yield Finding("note", "throttled", text, f"sudo usermod -aG video {case.user.name}, then log in again")
    if celsius is None:
        return
    limit = case.board.throttles_at if case.board else 0.0
    is_hot = bool(limit) and celsius > limit - NEARLY_HOT
    text = f"{celsius:.1f} °C" + (f", throttles from {limit:g} °C" if limit else "")
    yield Finding("note" if is_hot else "ok", "temperature", text, remedy[False] if is_hot else "")


def check_realtime_share(case: Case) -> Iterator[Finding]:
    """Check whether the kernel grants any time to real-time scheduling, if the scenario requests that."""
    if case.scenario and not case.scenario.slave.realtime:
        yield Finding("ok", "real time", "not requested: [slave] realtime is false")
    elif case.tree.text("/proc/sys/kernel/sched_rt_runtime_us") == "0":
        text = "the kernel grants no time to SCHED_FIFO: sched_rt_runtime_us is 0"
        yield Finding(case.severity, "real time", text, "sudo sysctl kernel.sched_rt_runtime_us=950000")


def check_clock(case: Case) -> Iterator[Finding]:
    """Check whether the clock is synchronised by NTP."""
    output = case.tree.run("timedatectl", "show", "--property=NTPSynchronized", "--value")
    if output == "yes":
        yield Finding("ok", "clock", "synchronised")
    elif output == "no":
        text = "not synchronised: dates of recordings and certificates, and delays between machines, are wrong"
        remedy = "sudo timedatectl set-ntp true; without internet, use chrony with the master's computer as its server"
        yield Finding(case.severity if case.remote else "note", "clock", text, remedy)
    else:
        yield Finding("note", "clock", "whether it is synchronised cannot be determined: timedatectl does not answer")
