"""How warm a board is, whether that or its power supply slows it down, and how its clock is governed.

Cheap enough to be asked once a second, but for the command that asks a Raspberry Pi's firmware.
"""

from typing import NamedTuple

from boards import Board, detect, load_board
from boards.tree import Tree, architecture

THERMAL = "/sys/class/thermal"
HWMON = "/sys/class/hwmon"
CPUS = "/sys/devices/system/cpu"
GENERIC = {"x86_64": "generic_x86_64", "aarch64": "generic_arm64"}
# Bits of `vcgencmd get_throttled`; 16 higher the same since the last boot. raspberrypi.com documentation, vcgencmd.
FIRMWARE = (
    "the supply voltage is too low", "the clock is capped", "throttled", "the soft temperature limit is reached"
)  # fmt: skip


class Throttling(NamedTuple):
    """What slows the processor down now, and what did before, in words; both empty if nothing is known to."""

    now: tuple[str, ...] = ()
    before: tuple[str, ...] = ()


def recognise(tree: Tree) -> Board | None:
    """The board a machine is, else what all of its architecture have in common; None for other architectures."""
    found = detect(tree.root)
    generic = GENERIC.get(architecture(tree))
    return found or (load_board(generic) if generic else None)


def temperatures(tree: Tree) -> dict[str, float]:
    """Thermal zone -> °C. Zones that are off or make no sense (-256 on Jetsons) are left out."""
    found: dict[str, float] = {}
    for zone in tree.names(THERMAL):
        if zone.startswith("thermal_zone"):
            value = tree.number(f"{THERMAL}/{zone}/temp")
            if value is not None and -40_000 < value < 150_000:
                found[tree.text(f"{THERMAL}/{zone}/type") or zone] = value / 1000.0
    return found


def temperature(tree: Tree, board: Board | None = None) -> float | None:
    """That of the processor (°C): the board's own zone, else the hottest; None without a sensor.

    The PMIC zone of Jetsons is a constant and left out.
    """
    found = temperatures(tree)
    for zone in board.thermal_zones if board else ():
        if zone in found:
            return found[zone]
    return max((value for zone, value in found.items() if not zone.startswith("PMIC")), default=None)


def throttling(tree: Tree, board: Board | None = None, ask_firmware: bool = True) -> Throttling:
    """What slows the processor down. With `ask_firmware` a Raspberry Pi's is asked, in a process of its own."""
    now, before = _by_cooling(tree), _by_counters(tree)
    if ask_firmware and board and board.throttling == "vcgencmd":
        bits = _firmware_bits(tree.run("vcgencmd", "get_throttled"))
        if bits is not None:
            now += [text for bit, text in enumerate(FIRMWARE) if bits & 1 << bit]
            before += [text for bit, text in enumerate(FIRMWARE) if bits & 1 << bit + 16]
            return Throttling(tuple(now), tuple(before))
    return Throttling((*now, *_by_voltage(tree)), tuple(before))


def governors(tree: Tree) -> dict[str, int]:
    """Frequency governor -> on how many processors; empty where the frequency is not the kernel's to set."""
    found: dict[str, int] = {}
    for name in tree.names(CPUS):
        governor = tree.text(f"{CPUS}/{name}/cpufreq/scaling_governor") if name[3:].isdigit() else ""
        if governor:
            found[governor] = found.get(governor, 0) + 1
    return found


def _firmware_bits(answer: str | None) -> int | None:
    try:
        return int((answer or "").rpartition("=")[2], 16)
    except ValueError:
        return None


def _by_voltage(tree: Tree) -> list[str]:
    """The Raspberry Pi's alarm as the kernel polls it (drivers/hwmon/raspberrypi-hwmon.c)."""
    alarms = [name for name in tree.names(HWMON) if tree.text(f"{HWMON}/{name}/name") == "rpi_volt"]
    return [FIRMWARE[0] for name in alarms if tree.number(f"{HWMON}/{name}/in0_lcrit_alarm")]


def _by_cooling(tree: Tree) -> list[str]:
    """Processors that the kernel holds back by their temperature: cooling devices of cpufreq above state 0."""
    devices = [f"{THERMAL}/{name}" for name in tree.names(THERMAL) if name.startswith("cooling_device")]
    held = [
        device
        for device in devices
        if "cpufreq" in tree.text(f"{device}/type") and (tree.number(f"{device}/cur_state") or 0) > 0
    ]
    return ["the clock is capped by the temperature"] if held else []


def _by_counters(tree: Tree) -> list[str]:
    """What Intel processors count since boot."""
    paths = [f"{CPUS}/{name}/thermal_throttle/core_throttle_count" for name in tree.names(CPUS) if name[3:].isdigit()]
    count = sum(tree.number(path) or 0 for path in paths)
    return [f"{count} times too hot"] if count else []
