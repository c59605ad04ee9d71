"""Temperature, throttling and governors, read from recorded machines."""

from pathlib import Path

import pytest

import boards
from boards.health import FIRMWARE, Throttling, governors, recognise, temperature, temperatures, throttling
from boards.tree import Tree
from tests.support.boards import recorded

REAL = [name for name in recorded.NAMES if not recorded.expected_board(name).startswith("generic")]


def tree_of(name: str, tmp_path: Path) -> Tree:
    return Tree(str(recorded.build(name, tmp_path)))


@pytest.mark.parametrize(
    ("name", "warmth"),
    [
        ("raspberry_pi_4b", 51.121),
        ("jetson_nano", 34.5),  # CPU-therm, not AO-therm which is warmer
        ("beaglebone_black", None),
        ("other_arm", 40.692),  # a zone of another name
        ("laptop", 52.0),
    ],
)
def test_the_processor_temperature_is_read(tmp_path: Path, name: str, warmth: float | None) -> None:
    tree = tree_of(name, tmp_path)
    assert temperature(tree, recognise(tree)) == warmth


def test_thermal_zones_that_are_off_are_ignored(tmp_path: Path) -> None:
    tree = tree_of("jetson_nano", tmp_path)
    assert temperatures(tree) == {"AO-therm": 41.5, "CPU-therm": 34.5, "PMIC-Die": 100.0}
    assert temperature(tree) == 41.5  # without knowing the board: the hottest, but not the PMIC's constant


@pytest.mark.parametrize(
    ("name", "slow"),
    [
        ("raspberry_pi_4b", Throttling((), (), True)),
        ("raspberry_pi_3b_plus", Throttling((FIRMWARE[3],), (FIRMWARE[3],), True)),
        ("raspberry_pi_zero_2w", Throttling((FIRMWARE[0], FIRMWARE[2]), (FIRMWARE[0], FIRMWARE[2]), True)),
        ("raspberry_pi_cm4", Throttling((), (), False)),  # no vcgencmd there
        ("jetson_orin_nano", Throttling(("the clock is capped by the temperature",), (), True)),
        ("jetson_nano", Throttling((), (), False)),  # no cooling device of cpufreq there
        ("laptop", Throttling((), ("12 times too hot",), True)),
    ],
)
def test_throttling_is_decoded(tmp_path: Path, name: str, slow: Throttling) -> None:
    tree = tree_of(name, tmp_path)
    assert throttling(tree, recognise(tree)) == slow


@pytest.mark.parametrize("kind", ["thermal-cpufreq-0", "cpufreq-cpu0"])  # of Linux 4.9, and of later ones
@pytest.mark.parametrize(("state", "is_known"), [("0\n", True), ("", False), ("\xff\n", False)])
def test_an_idle_cooling_device_means_no_throttling(tmp_path: Path, kind: str, state: str, is_known: bool) -> None:
    tree = tree_of("jetson_nano", tmp_path)
    recorded.plant(tmp_path, "sys/class/thermal/cooling_device0/type", "pwm-fan\n")
    recorded.plant(tmp_path, "sys/class/thermal/cooling_device0/cur_state", "2\n")
    assert not throttling(tree).known
    recorded.plant(tmp_path, "sys/class/thermal/cooling_device1/type", kind)
    recorded.plant(tmp_path, "sys/class/thermal/cooling_device1/cur_state", state)
    assert throttling(tree) == Throttling(known=is_known)


@pytest.mark.parametrize("name", REAL)
def test_the_boards_limit_is_not_above_the_firmwares(tmp_path: Path, name: str) -> None:
    """The firmware's limit must not lie below the board's own."""
    tree, board = tree_of(name, tmp_path), boards.load_board(recorded.expected_board(name))
    warmth = temperature(tree, board)
    if warmth is not None and FIRMWARE[3] in throttling(tree, board).now:
        assert warmth >= board.throttles_at


def test_unreadable_files_give_unknown_health(tmp_path: Path) -> None:
    undecodable = b"\xff\xfe\x80 \xc3"
    for name in (
        "sys/class/thermal/thermal_zone0/temp", "sys/class/thermal/thermal_zone0/type",
        "sys/class/thermal/cooling_device0/type", "sys/class/thermal/cooling_device0/cur_state",
        "sys/class/hwmon/hwmon0/name", "sys/devices/system/cpu/cpu0/thermal_throttle/core_throttle_count",
        "proc/cpuinfo", "proc/sys/kernel/arch", "proc/device-tree/model", "commands/vcgencmd_get_throttled",
    ):  # fmt: skip
        recorded.plant(tmp_path, name, "")
        (tmp_path / name).write_bytes(undecodable)
    tree = Tree(str(tmp_path))
    assert (temperatures(tree), recognise(tree), governors(tree)) == ({}, None, {})
    assert throttling(tree, boards.load_board("raspberry_pi_4b")) == Throttling(known=False)
    assert throttling(tree) == Throttling(known=False)


def test_the_kernel_alarm_is_used_without_a_firmware_query(tmp_path: Path) -> None:
    tree = tree_of("raspberry_pi_4b", tmp_path)
    recorded.plant(tmp_path, "sys/class/hwmon/hwmon1/in0_lcrit_alarm", "1\n")
    recorded.plant(tmp_path, "commands/vcgencmd_get_throttled", "throttled=0xf0000\n")
    board = recognise(tree)
    assert throttling(tree, board, ask_firmware=False) == Throttling((FIRMWARE[0],), ())
    assert throttling(tree, board) == Throttling((), FIRMWARE, True)


@pytest.mark.parametrize("soc", ["soc/soc:firmware", "soc@107c000000/soc@107c000000:firmware"])  # the latter of a Pi 5
def test_the_kernel_log_is_used_without_a_firmware_query(tmp_path: Path, soc: str) -> None:
    tree = tree_of("raspberry_pi_4b", tmp_path)
    board, received = recognise(tree), f"sys/devices/platform/{soc}/get_throttled"
    assert not throttling(tree, board, ask_firmware=False).known
    for text, now in (("80008\n", (FIRMWARE[3],)), ("50005\n", (FIRMWARE[0], FIRMWARE[2])), ("0\n", ())):
        recorded.plant(tmp_path, received, text)
        assert throttling(tree, board, ask_firmware=False) == Throttling(now, (), True)
    recorded.plant(tmp_path, received, "soon\n")
    assert not throttling(tree, board, ask_firmware=False).known


def test_governors_are_counted(tmp_path: Path) -> None:
    tree = tree_of("raspberry_pi_4b", tmp_path)
    recorded.plant(tmp_path, "sys/devices/system/cpu/cpu3/cpufreq/scaling_governor", "ondemand\n")
    assert governors(tree) == {"performance": 3, "ondemand": 1}


def test_an_empty_machine_has_no_health_data(tmp_path: Path) -> None:
    tree = Tree(str(tmp_path))
    assert (temperatures(tree), temperature(tree), throttling(tree), governors(tree)) == ({}, None, Throttling(), {})
