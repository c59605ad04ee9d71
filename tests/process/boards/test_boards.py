"""Every board file loads and names the sources of its numbers; every recorded machine is recognised."""

import os
import re
from pathlib import Path

import pytest

import boards
from boards.health import recognise
from boards.resources import find_openers
from boards.tree import Tree, architecture
from hil.common.errors import ConfigError
from hil.common.schema import preset_names
from hil.scenario.records import Slave
from tests.support.boards import recorded

NAMES = preset_names("boards")
REAL_BOARDS = [name for name in NAMES if not name.startswith("generic")]


@pytest.mark.parametrize("name", NAMES)
def test_every_board_names_the_source_of_each_number(name: str) -> None:
    board = boards.load_board(name)
    assert board.source
    reported = {
        "cpu": board.cpu,
        "cores": board.cores,
        "ram": board.ram,
        "system": board.system,
        "wlan": board.wlan,
        "throttles_at": board.throttles_at,
    }
    if name in REAL_BOARDS:
        assert {key for key, value in reported.items() if value} <= set(board.sources)
    sources = [row.source for row in board.serial] + [row.source for row in board.can]
    assert all([*sources, *(mode.source for mode in board.power), board.recommended.source, board.budgets.reason])
    assert set(board.sources) <= set(board._fields)


@pytest.mark.parametrize("name", REAL_BOARDS)
def test_a_real_board_has_a_serial_port_and_model_names(name: str) -> None:
    board = boards.load_board(name)
    assert board.models
    assert board.uart.startswith("/dev/tty") or board.uart == "/dev/serial0"
    assert board.cores >= 1
    assert board.ram
    assert board.system


@pytest.mark.parametrize(("name", "first", "spi"), [("raspberry_pi_4b", 2, "uart4"), ("raspberry_pi_cm4", 2, "uart4"),
                                                   ("raspberry_pi_5", 1, "uart3"), ("raspberry_pi_cm5", 1, "uart3"),
                                                   ("raspberry_pi_400", 2, "uart4")])  # fmt: skip
def test_further_ports_of_a_raspberry_pi_are_numbered_as_their_uarts(name: str, first: int, spi: str) -> None:
    board = boards.load_board(name)
    for number, port in enumerate(board.serial[1:], first):
        assert port.device == f"/dev/ttyAMA{number}"
        assert f"dtoverlay=uart{number}" in port.needs
        assert f"uart{number}" in port.at
        assert ("SPI0" in port.at) == (f"uart{number}" == spi) == ("GPIO 8 and 9" in port.at)
    assert len(board.serial) == 5
    assert spi in board.can[0].controller


@pytest.mark.parametrize("name", NAMES)
def test_measured_load_of_the_slave_matches_the_readme(name: str) -> None:
    """The recommendation leaves room above the measured memory."""
    recommended = boards.load_board(name).recommended
    shown = (Path(boards.__file__).parents[1] / "README.md").read_text()
    rows = (r"slave memory, alone on its machine \(MiB\)", r"slave CPU \(% of a core\)")
    (memory,), (cpu,) = (re.findall(rf"{row} .* ([0-9.]+)\n", shown) for row in rows)
    low, high, mib = map(
        float, *re.findall(r"took ([0-9]+) to ([0-9]+) % of a core .* and ([0-9]+) MiB", recommended.source)
    )
    assert low - 0.5 < float(cpu) < high + 0.5
    assert mib == pytest.approx(float(memory), abs=1.5)
    assert recommended.memory >= 2 * mib


@pytest.mark.parametrize("name", NAMES)
def test_recommended_settings_are_valid_for_the_slave(name: str) -> None:
    recommended = boards.load_board(name).recommended
    slave = Slave(step=recommended.step, control_period=recommended.control_period)
    assert slave.validate() is None
    assert recommended.control_period / recommended.step == pytest.approx(
        round(recommended.control_period / recommended.step)
    )


@pytest.mark.parametrize("name", recorded.NAMES)
def test_every_recorded_machine_is_recognised(tmp_path: Path, name: str) -> None:
    found = recognise(Tree(str(recorded.build(name, tmp_path))))
    assert found == boards.load_board(recorded.expected_board(name))


@pytest.mark.parametrize(
    ("model", "name"),
    [
        ("Raspberry Pi 4 Model B Rev 1.5\0", "Raspberry Pi 4 Model B"),
        ("Raspberry Pi 3 Model B+\0", "Raspberry Pi 3 Model B+"),
        ("Raspberry Pi 3 Model B Rev 1.2\0", "Raspberry Pi 3 Model B"),
        ("Raspberry Pi 3 Model B Plus Rev 1.3\0", "Raspberry Pi 3 Model B+"),
        ("Raspberry Pi Compute Module 5 Lite Rev 1.0\0", "Raspberry Pi Compute Module 5"),
        ("Raspberry Pi 500 Rev 1.0\0", None),
        ("Raspberry Pi Compute Module 4S Rev 1.0\0", None),
        ("NVIDIA Jetson Nano Developer Kit\0", "NVIDIA Jetson Nano"),
        ("NVIDIA Jetson Nano 2GB Developer Kit\0", "NVIDIA Jetson Nano"),
        ("NVIDIA Jetson Xavier NX Developer Kit (SD-card)\0", "NVIDIA Jetson Xavier NX"),
        ("NVIDIA Orin Nano Developer Kit\0", "NVIDIA Jetson Orin Nano"),
        ("NVIDIA Jetson Orin Nano Developer Kit Super\0", "NVIDIA Jetson Orin Nano"),
        ("NVIDIA Orin NX Developer Kit\0", "NVIDIA Jetson Orin NX"),
        ("TI AM335x BeagleBone Black Wireless\0", "BeagleBone Black"),
        ("TI AM335x BeagleBone Green\0", "BeagleBone Black"),
        ("TI AM335x BeagleBone Blue\0", None),
        ("Some Other Board\0", None),
        ("", None),
    ],
)
def test_the_model_name_selects_the_board(tmp_path: Path, model: str, name: str | None) -> None:
    recorded.plant(tmp_path, "proc/device-tree/model", model)
    found = boards.detect(str(tmp_path))
    assert (found.name if found else None) == name


def test_a_machine_without_information_is_not_recognised(tmp_path: Path) -> None:
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
def test_the_architecture_is_derived_from_cpuinfo_on_older_kernels(tmp_path: Path, text: str, name: str) -> None:
    recorded.plant(tmp_path, "proc/cpuinfo", f"processor\t: 0\n{text}")
    assert architecture(Tree(str(tmp_path))) == name


def test_a_wrong_board_file_is_refused_by_its_key(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    valid_text = (Path(boards.__file__).parent / "raspberry_pi_4b.toml").read_text()
    path.write_text(valid_text.replace('"1 GiB"', '"1"'))
    with pytest.raises(ConfigError, match=r"mine\.toml: ram\[0\].*unit"):
        boards.load_board(str(path))
    path.write_text(valid_text.replace("source =", "sauce =", 1))
    with pytest.raises(ConfigError, match=r"no key 'sauce'; did you mean 'source'"):
        boards.load_board(str(path))


def test_device_links_are_resolved_within_the_tree(tmp_path: Path) -> None:
    recorded.link(tmp_path, "dev/uuv", "/dev/serial0")
    recorded.link(tmp_path, "dev/serial0", "ttyS0")
    recorded.link(tmp_path, "dev/loop", "loop")
    tree = Tree(str(tmp_path))
    assert tree.resolve("/dev/uuv") == "/dev/ttyS0"
    assert tree.resolve("/dev/loop") == "/dev/loop"
    assert tree.resolve("/dev/ttyUSB0") == "/dev/ttyUSB0"


def test_commands_run_on_this_machine() -> None:
    tree = Tree("/")
    assert tree.run("echo", "there") == "there"
    assert tree.run("false") is None
    assert tree.run("no-such-command-here") is None


def test_an_absolute_link_is_resolved_inside_the_tree(tmp_path: Path) -> None:
    root = tmp_path / "root"
    recorded.plant(root, "sys/firmware/devicetree/base/model", "Raspberry Pi 4 Model B Rev 1.5\0")
    recorded.link(root, "proc/device-tree", "/sys/firmware/devicetree/base")
    found = boards.detect(str(root))
    assert found is not None
    assert found.name == "Raspberry Pi 4 Model B"
    assert Tree(str(root)).names("/proc/device-tree") == ["model"]


@pytest.mark.parametrize("target", ["/outside/model", "../../outside/model", "{outside}/model"])
def test_no_link_leads_out_of_the_tree(tmp_path: Path, target: str) -> None:
    recorded.plant(tmp_path, "outside/model", "Raspberry Pi 5 Model B Rev 1.0\0")
    recorded.link(tmp_path / "root", "proc/device-tree/model", target.format(outside=tmp_path / "outside"))
    tree = Tree(str(tmp_path / "root"))
    assert tree.text("/proc/device-tree/model") == ""
    assert not tree.exists("/proc/device-tree/model")
    assert tree.text("/../outside/model") == ""
    assert boards.detect(tree.root) is None


def test_circular_links_are_treated_as_missing(tmp_path: Path) -> None:
    recorded.link(tmp_path, "dev/one", "/dev/two")
    recorded.link(tmp_path, "dev/two", "one")
    tree = Tree(str(tmp_path))
    assert tree.text("/dev/one") == ""
    assert tree.names("/dev/one") == []
    assert not tree.exists("/dev/two/below")
    assert not os.path.lexists(tree.path("/dev/one"))
    assert tree.link("/dev/one") == "/dev/two"


def test_undecodable_names_and_contents_are_treated_as_missing(tmp_path: Path) -> None:
    (tmp_path / "proc").mkdir()
    (tmp_path / "proc/cpuinfo").write_bytes(b"CPU architecture: 8\nflags\t: \xff\xfe\n")
    (tmp_path / "proc/device-tree").mkdir()
    (tmp_path / "proc/device-tree/model").write_bytes(b"\xff\xfeRaspberry Pi 4")
    (tmp_path / "proc/\N{SUPERSCRIPT TWO}/fd").mkdir(parents=True)
    tree = Tree(str(tmp_path))
    assert architecture(tree) == "aarch64"
    assert boards.detect(str(tmp_path)) is None
    assert find_openers(tree, "/dev/ttyS0") == []
    assert (tree.text("a\0b"), tree.names("a\0b"), tree.link("a\0b"), tree.exists("a\0b")) == ("", [], "", False)
