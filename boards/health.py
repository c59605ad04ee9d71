"""Health of a board: temperature, throttling by heat or power supply, and frequency governors.

All functions are fast enough to be called every second, except the query of a Raspberry Pi's firmware.

The slave reads temperatures every second without psutil (hil/slave/usage.py). Other programs use the same code,
because psutil.sensors_temperatures (7.2.2) reads only the /sys of this machine, not of a recorded one. It also leaves
out the thermal zones, by which boards name their sensor, if /sys/class/hwmon has any temperature, such as a disk's.
"""

from contextlib import suppress
from typing import NamedTuple

from boards import Board, detect, load_board
from boards.tree import Tree, architecture

THERMAL = "/sys/class/thermal"
HWMON = "/sys/class/hwmon"
CPUS = "/sys/devices/system/cpu"
PLATFORM = "/sys/devices/platform"
GENERIC = {"x86_64": "generic_x86_64", "aarch64": "generic_arm64"}
# Bits 0 to 3 of `vcgencmd get_throttled`; bits 16 to 19: the same since boot. Source: raspberrypi.com, vcgencmd.
FIRMWARE = (
    "the supply voltage is too low", "the clock is capped", "throttled", "the soft temperature limit is reached"
)  # fmt: skip


class Throttling(NamedTuple):
    """Reasons (text) why the processor is throttled now, and why it was before.

    `known` is False if this machine does not report throttling; then both are empty.
    """

    now: tuple[str, ...] = ()
    before: tuple[str, ...] = ()
    known: bool = False


def recognise(tree: Tree) -> Board | None:
    """Return the board of a machine, or else the generic board of its architecture; None for other architectures."""
    board = detect(tree.root)
    generic = GENERIC.get(architecture(tree))
    return board or (load_board(generic) if generic else None)


def temperatures(tree: Tree) -> dict[str, float]:
    """Return temperatures (°C) by thermal zone. Zones that are off or implausible (-256 on Jetsons) are left out."""
    by_zone: dict[str, float] = {}
    for zone in tree.names(THERMAL):
        if zone.startswith("thermal_zone"):
            value = tree.number(f"{THERMAL}/{zone}/temp")
            if value is not None and -40_000 < value < 150_000:
                by_zone[tree.text(f"{THERMAL}/{zone}/type") or zone] = value / 1000.0
    return by_zone


def temperature(tree: Tree, board: Board | None = None) -> float | None:
    """Return the processor's temperature (°C): of the board's zone, or else of the hottest; None without a sensor.

    The PMIC zone of Jetsons is constant, and left out.
    """
    by_zone = temperatures(tree)
    for zone in board.thermal_zones if board else ():
        if zone in by_zone:
            return by_zone[zone]
    return max((value for zone, value in by_zone.items() if not zone.startswith("PMIC")), default=None)


def throttling(tree: Tree, board: Board | None = None, ask_firmware: bool = True) -> Throttling:
    """Return why the processor is throttled. With `ask_firmware` a process queries a Raspberry Pi's firmware.

    Otherwise, or if that fails, the kernel's last reading is used, which it updates every 2 s.
    """
    cooling, counters = _by_cooling(tree), _by_counters(tree)
    now, before = cooling or [], counters or []
    if board is None or board.throttling == "kernel":
        known = cooling is not None or counters is not None
        return Throttling((*now, *_by_voltage(tree)), tuple(before), known)
    bits = _firmware_bits(tree.run("vcgencmd", "get_throttled")) if ask_firmware else None
    if bits is None:
        bits = _bits_of_the_kernel(tree)
    if bits is None:  # then the kernel reports only the voltage
        return Throttling((*now, *_by_voltage(tree)), tuple(before))
    now += [text for bit, text in enumerate(FIRMWARE) if bits & 1 << bit]
    before += [text for bit, text in enumerate(FIRMWARE) if bits & 1 << bit + 16]
    return Throttling(tuple(now), tuple(before), known=True)


def _bits_of_the_kernel(tree: Tree) -> int | None:
    """Return the bits that a Raspberry Pi's kernel last read from its firmware: raspberrypi/linux, pull request 2397.

    The kernel clears the history at each query, so only the present state is reported.
    """
    for soc in [name for name in tree.names(PLATFORM) if name.startswith("soc")]:
        for part in [name for name in tree.names(f"{PLATFORM}/{soc}") if name.endswith(":firmware")]:
            with suppress(ValueError):
                return int(tree.text(f"{PLATFORM}/{soc}/{part}/get_throttled"), 16) & 0xFFFF
    return None


def governors(tree: Tree) -> dict[str, int]:
    """Return the number of processors by frequency governor; empty if the kernel does not set the frequency."""
    counts: dict[str, int] = {}
    for name in tree.names(CPUS):
        governor = tree.text(f"{CPUS}/{name}/cpufreq/scaling_governor") if name[3:].isdigit() else ""
        if governor:
            counts[governor] = counts.get(governor, 0) + 1
    return counts


def _firmware_bits(output: str | None) -> int | None:
    try:
        return int((output or "").rpartition("=")[2], 16)
    except ValueError:
        return None


def _by_voltage(tree: Tree) -> list[str]:
    """Return the Raspberry Pi's undervoltage alarm as the kernel polls it (drivers/hwmon/raspberrypi-hwmon.c)."""
    alarms = [name for name in tree.names(HWMON) if tree.text(f"{HWMON}/{name}/name") == "rpi_volt"]
    return [FIRMWARE[0] for name in alarms if tree.number(f"{HWMON}/{name}/in0_lcrit_alarm")]


def _by_cooling(tree: Tree) -> list[str] | None:
    """Return a reason if the kernel throttles a processor by temperature: a cpufreq cooling device above state 0.

    None if there is no such device; kernels of vendors may use different names.
    """
    devices = [f"{THERMAL}/{name}" for name in tree.names(THERMAL) if name.startswith("cooling_device")]
    states = [tree.number(f"{device}/cur_state") for device in devices if "cpufreq" in tree.text(f"{device}/type")]
    known = [state for state in states if state is not None]
    if not known:
        return None
    return ["the clock is capped by the temperature"] if max(known) > 0 else []


def _by_counters(tree: Tree) -> list[str] | None:
    """Return the thermal throttling that Intel processors have counted since boot; None without counters."""
    paths = [f"{CPUS}/{name}/thermal_throttle/core_throttle_count" for name in tree.names(CPUS) if name[3:].isdigit()]
    counts = [count for count in map(tree.number, paths) if count is not None]
    if not counts:
        return None
    return [f"{sum(counts)} times too hot"] if sum(counts) > 0 else []
