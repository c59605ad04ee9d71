"""Warmth, throttling and governors, read from recorded machines."""

from pathlib import Path

import pytest

from boards.health import FIRMWARE, Throttling, governors, recognise, temperature, temperatures, throttling
from boards.tree import Tree
from tests.boards import recorded


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
def test_the_processors_temperature(tmp_path: Path, name: str, warmth: float | None) -> None:
    tree = tree_of(name, tmp_path)
    assert temperature(tree, recognise(tree)) == warmth


def test_zones_that_are_off_are_none(tmp_path: Path) -> None:
    tree = tree_of("jetson_nano", tmp_path)
    assert temperatures(tree) == {"AO-therm": 41.5, "CPU-therm": 34.5, "PMIC-Die": 100.0}
    assert temperature(tree) == 41.5  # without knowing the board: the hottest, but not the PMIC's constant


@pytest.mark.parametrize(
    ("name", "now", "before"),
    [
        ("raspberry_pi_4b", (), ()),
        ("raspberry_pi_3b_plus", (FIRMWARE[3],), (FIRMWARE[3],)),
        ("raspberry_pi_zero_2w", (FIRMWARE[0], FIRMWARE[2]), (FIRMWARE[0], FIRMWARE[2])),
        ("raspberry_pi_cm4", (), ()),  # no vcgencmd there
        ("jetson_orin_nano", ("the clock is capped by the temperature",), ()),
        ("laptop", (), ("12 times too hot",)),
    ],
)
def test_throttling(tmp_path: Path, name: str, now: tuple[str, ...], before: tuple[str, ...]) -> None:
    tree = tree_of(name, tmp_path)
    assert throttling(tree, recognise(tree)) == Throttling(now, before)


def test_the_kernels_alarm_when_the_firmware_is_not_asked(tmp_path: Path) -> None:
    tree = tree_of("raspberry_pi_4b", tmp_path)
    recorded.plant(tmp_path, "sys/class/hwmon/hwmon1/in0_lcrit_alarm", "1\n")
    recorded.plant(tmp_path, "commands/vcgencmd_get_throttled", "throttled=0xf0000\n")
    board = recognise(tree)
    assert throttling(tree, board, ask_firmware=False) == Throttling((FIRMWARE[0],), ())
    assert throttling(tree, board) == Throttling((), FIRMWARE)


def test_governors(tmp_path: Path) -> None:
    tree = tree_of("raspberry_pi_4b", tmp_path)
    recorded.plant(tmp_path, "sys/devices/system/cpu/cpu3/cpufreq/scaling_governor", "ondemand\n")
    assert governors(tree) == {"performance": 3, "ondemand": 1}


def test_an_empty_machine(tmp_path: Path) -> None:
    tree = Tree(str(tmp_path))
    assert (temperatures(tree), temperature(tree), throttling(tree), governors(tree)) == ({}, None, Throttling(), {})
