"""Every board file loads and says where its numbers are from; every recorded machine is recognised."""

from pathlib import Path

import pytest

import boards
from boards.health import recognise
from boards.tree import Tree, architecture
from hil.config import Slave
from hil.errors import ConfigError
from hil.schema import preset_names
from tests.boards import recorded

NAMES = preset_names("boards")
REAL = [name for name in NAMES if not name.startswith("generic")]


@pytest.mark.parametrize("name", NAMES)
def test_every_board_names_the_source_of_each_number(name: str) -> None:
    board = boards.load_board(name)
    assert board.source
    told = {
        "cpu": board.cpu,
        "cores": board.cores,
        "ram": board.ram,
        "wlan": board.wlan,
        "throttles_at": board.throttles_at,
    }
    if name in REAL:
        assert {key for key, value in told.items() if value} <= set(board.sources)
    sources = [row.source for row in board.serial] + [row.source for row in board.can]
    assert all([*sources, *(mode.source for mode in board.power), board.recommended.source, board.budgets.reason])
    assert set(board.sources) <= set(board._fields)


@pytest.mark.parametrize("name", REAL)
def test_a_real_board_has_a_port_and_can_be_recognised(name: str) -> None:
    board = boards.load_board(name)
    assert board.models
    assert board.uart.startswith("/dev/tty") or board.uart == "/dev/serial0"
    assert board.cores >= 1
    assert board.ram


def test_all_that_were_asked_for_are_there() -> None:
    wanted = {
        "raspberry_pi_3b_plus", "raspberry_pi_4b", "raspberry_pi_5", "raspberry_pi_zero_2w", "raspberry_pi_cm4",
        "jetson_nano", "jetson_xavier_nx", "jetson_orin_nano", "beaglebone_black", "generic_x86_64", "generic_arm64",
    }  # fmt: skip
    assert wanted <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_recommended_goes_with_the_slave(name: str) -> None:
    asked = boards.load_board(name).recommended
    slave = Slave(step=asked.step, control_period=asked.control_period)
    assert slave.problem() is None
    assert asked.control_period / asked.step == pytest.approx(round(asked.control_period / asked.step))


@pytest.mark.parametrize("name", recorded.NAMES)
def test_every_recorded_machine_is_recognised(tmp_path: Path, name: str) -> None:
    found = recognise(Tree(str(recorded.build(name, tmp_path))))
    assert found == boards.load_board(recorded.expected_board(name))


def test_every_board_has_a_recorded_machine() -> None:
    assert {recorded.expected_board(name) for name in recorded.NAMES} == set(NAMES)


@pytest.mark.parametrize(
    ("model", "name"),
    [
        ("Raspberry Pi 4 Model B Rev 1.5\0", "Raspberry Pi 4 Model B"),
        ("Raspberry Pi 3 Model B+\0", "Raspberry Pi 3 Model B+"),
        ("Raspberry Pi 3 Model B Rev 1.2\0", None),
        ("Raspberry Pi 500 Rev 1.0\0", None),
        ("Raspberry Pi Compute Module 4S Rev 1.0\0", None),
        ("NVIDIA Jetson Nano Developer Kit\0", "NVIDIA Jetson Nano"),
        ("NVIDIA Jetson Xavier NX Developer Kit (SD-card)\0", "NVIDIA Jetson Xavier NX"),
        ("Some Other Board\0", None),
        ("", None),
    ],
)
def test_detection(tmp_path: Path, model: str, name: str | None) -> None:
    recorded.plant(tmp_path, "proc/device-tree/model", model)
    found = boards.detect(str(tmp_path))
    assert (found.name if found else None) == name


def test_a_machine_that_tells_nothing(tmp_path: Path) -> None:
    assert boards.detect(str(tmp_path)) is None
    assert recognise(Tree(str(tmp_path))) is None
    assert architecture(Tree(str(tmp_path))) == ""


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("vendor_id\t: GenuineIntel\n", "x86_64"),
        ("CPU architecture: 8\n", "aarch64"),
        ("CPU architecture: 7\n", "armv7l"),
    ],
)
def test_architecture_of_older_kernels(tmp_path: Path, text: str, name: str) -> None:
    recorded.plant(tmp_path, "proc/cpuinfo", f"processor\t: 0\n{text}")
    assert architecture(Tree(str(tmp_path))) == name


def test_a_wrong_board_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    good = (Path(boards.__file__).parent / "raspberry_pi_4b.toml").read_text()
    path.write_text(good.replace('"1 GiB"', '"1"'))
    with pytest.raises(ConfigError, match=r"mine\.toml: ram\[0\].*unit"):
        boards.load_board(str(path))
    path.write_text(good.replace("source =", "sauce =", 1))
    with pytest.raises(ConfigError, match=r"no key 'sauce'; did you mean 'source'"):
        boards.load_board(str(path))


def test_names_of_devices_are_followed_within_the_tree(tmp_path: Path) -> None:
    recorded.link(tmp_path, "dev/uuv", "/dev/serial0")
    recorded.link(tmp_path, "dev/serial0", "ttyS0")
    recorded.link(tmp_path, "dev/loop", "loop")
    tree = Tree(str(tmp_path))
    assert tree.resolve("/dev/uuv") == "/dev/ttyS0"
    assert tree.resolve("/dev/loop") == "/dev/loop"
    assert tree.resolve("/dev/ttyUSB0") == "/dev/ttyUSB0"


def test_commands_of_this_machine() -> None:
    tree = Tree("/")
    assert tree.run("echo", "there") == "there"
    assert tree.run("false") is None
    assert tree.run("no-such-command-here") is None
