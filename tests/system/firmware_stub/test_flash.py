"""`uuv-hil stm32 flash` by the real pyOCD with an emulated probe and chip, and with a stand-in for dfu-util."""

import hashlib
import io
import re
import sys
from pathlib import Path
from typing import Any

import pytest

from firmware_stub.image import CHIPS, load_image, parameters
from hil.cli import main

pytest.importorskip("pyocd")
pytest.importorskip("unicorn")

from tests.support.firmware.fake_probe import FakeChip, FakeProbe
from tests.unit.firmware_stub.test_flash_content import LISTED

# The program on PATH: it lists boards, stores what it is given, and answers as dfu-util 0.11 does.
DFU_UTIL = """\
#!{python}
import shutil, sys
from pathlib import Path
here = Path(__file__).parent
words = sys.argv[1:]
with open(here / "log", "a") as log:
    print(*words[:-1] if "-D" in words else words, file=log)
if words == ["-l"]:
    print((here / "listed").read_text())
elif (here / "fails").exists():
    sys.exit("dfu-util: Error during download get_status: LIBUSB_ERROR_PIPE")
else:
    shutil.copyfile(words[-1], here / words[words.index("-s") + 1].split(":")[0])
    print("Downloading element to address = 0x08000000, size = 9960")
    print("Download done.")
    print("File downloaded successfully")
    if words[words.index("-s") + 1].endswith(":leave"):
        sys.exit("dfu-util: Error during download get_status")  # the board has left
"""


def connect(monkeypatch: pytest.MonkeyPatch, *probes: FakeProbe) -> None:
    from pyocd.core.helpers import ConnectHelper

    monkeypatch.setattr(ConnectHelper, "get_all_connected_probes", lambda **_: list(probes))


@pytest.mark.parametrize("chip", CHIPS)
def test_the_board_is_recognised_and_gets_its_image(
    chip: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    board, image = FakeChip(chip), load_image(chip)
    probe = FakeProbe(board)
    connect(monkeypatch, probe)
    assert main(["stm32", "flash", "--yes"]) == 0
    output = capsys.readouterr().out
    assert f"STM32 STLink 066DFF515049657187: {image.chip}, device id {image.device_ids[0]:#05x}" in output
    assert image.outputs[7] in output
    assert "not on hardware yet" in output
    assert bytes(board.flash[: image.size]) == Path(image.path).read_bytes()
    page = 1024 if chip == "f103" else 16 * 1024
    assert board.erased == [0x0800_0000 + i * page for i in range((image.size - 1) // page + 1)]
    assert bytes(board.flash[0x4000:]) == b"\x55" * (len(board.flash) - 0x4000), "nothing else is touched"
    assert board.resets >= 2, "before it is written, and to start it"
    assert not probe.held_in_reset, "which needs a wire that not every probe has"


def test_parameters_are_written_if_one_is_given(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    board = FakeChip("f446")
    connect(monkeypatch, FakeProbe(board))
    assert main(["stm32", "flash", "--yes", "--channels", "8", "--watchdog", "0.5 s"]) == 0
    assert bytes(board.flash[0x4000:0x4014]) == parameters(8, 0.5)
    assert "20 bytes at 0x08004000 written and compared" in capsys.readouterr().out


@pytest.fixture
def own_image(tmp_path: Path) -> Path:
    """Return an image for the F405 that was made for a crystal of 12 MHz."""
    path = tmp_path / "mine.bin"
    path.write_bytes(b"another program")
    description = Path(load_image("f405").path).with_suffix(".toml").read_text()
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    description = re.sub('sha256 = "[^"]*"', f'sha256 = "{digest}"', description)
    path.with_suffix(".toml").write_text(description)
    return path


def test_an_own_image_with_its_description_is_written(
    own_image: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    board = FakeChip("f405")
    connect(monkeypatch, FakeProbe(board))
    assert main(["stm32", "flash", "--yes", "--image", str(own_image)]) == 0
    assert bytes(board.flash[:16]) == b"another program\xff"
    assert f"image: {own_image}" in capsys.readouterr().out


def test_an_own_image_for_another_chip_is_refused(
    own_image: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    board = FakeChip("f411")
    connect(monkeypatch, FakeProbe(board))

    def refusal(*arguments: str, code: int = 2) -> str:
        assert main(["stm32", "flash", "--yes", "--image", str(own_image), *arguments]) == code
        return capsys.readouterr().err

    assert "has an STM32F411 (device id 0x431), and the image is for an STM32F405" in refusal()
    assert "--chip f411: but" in refusal("--chip", "f411")
    own_image.write_bytes(b"damaged")
    assert "mine.bin: damaged" in refusal("--dry-run", code=3)
    text = own_image.with_suffix(".toml").read_text()
    own_image.with_suffix(".toml").write_text(text.replace('"STM32F405"', '"STM32F722"'))
    assert "is for an STM32F722; boards with f103, f405, f411, f446 are written" in refusal()
    own_image.with_suffix(".toml").unlink()
    assert "no valid description beside it" in refusal()
    own_image.unlink()
    assert "mine.bin: no such file" in refusal()
    own_image.mkdir()
    assert "mine.bin: a folder; name a FILE.bin" in refusal()
    assert not board.erased


def test_a_dry_run_writes_nothing(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    board = FakeChip("f411")
    connect(monkeypatch, FakeProbe(board))
    assert main(["stm32", "flash", "--dry-run"]) == 0
    assert f"would write: {load_image('f411').size} bytes at 0x08000000" in capsys.readouterr().out
    assert not board.erased


@pytest.mark.parametrize(
    ("chips", "arguments", "code", "refusal"),
    [
        ([], [], 3, "no debug probe found: connect an ST-LINK"),
        (["f405", "f411"], [], 3, "2 debug probes: choose one with --probe NUMBER, of: 00AA (STM32 STLink); 01AA"),
        (["f405"], ["--probe", "FF"], 3, "no debug probe with 'FF' in its number; there are: 00AA"),
        (["f411"], ["--chip", "f405"], 2, "has an STM32F411 (device id 0x431), and the image is for an STM32F405"),
    ],
)
def test_what_prevents_flashing_is_reported(
    chips: list[str], arguments: list[str], code: int, refusal: str,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:  # fmt: skip
    boards = [FakeChip(chip) for chip in chips]
    connect(monkeypatch, *[FakeProbe(board, f"{i:02}AA") for i, board in enumerate(boards)])
    assert main(["stm32", "flash", "--yes", *arguments]) == code
    assert refusal in capsys.readouterr().err
    assert not any(board.erased for board in boards)


def test_one_of_several_probes_is_chosen_by_a_part_of_its_number(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    boards = [FakeChip("f405"), FakeChip("f411")]
    connect(monkeypatch, *[FakeProbe(board, f"{i:02}AA") for i, board in enumerate(boards)])
    assert main(["stm32", "flash", "--yes", "--probe", "01a"]) == 0
    assert [bool(board.erased) for board in boards] == [False, True]


def test_the_chip_is_written_under_reset_on_request(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    probe = FakeProbe(FakeChip("f103"))
    connect(monkeypatch, probe)
    assert main(["stm32", "flash", "--yes", "--under-reset"]) == 0
    assert probe.held_in_reset
    assert probe.chip.flash[0] != 0x55


def test_a_chip_that_does_not_answer_is_reported(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    probe = FakeProbe(FakeChip("f103"))
    probe.is_responding = False
    connect(monkeypatch, probe)
    assert main(["stm32", "flash", "--yes"]) == 3
    assert "check SWDIO, SWCLK, GND and the chip's supply, or try --under-reset" in capsys.readouterr().err


def test_a_chip_of_another_kind_is_refused_by_its_name(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    board = FakeChip("f405", device_id=0x419)
    connect(monkeypatch, FakeProbe(board))
    assert main(["stm32", "flash", "--yes"]) == 2
    assert "the board has an STM32F42x or F43x (device id 0x419), and there is no image" in capsys.readouterr().err


def test_a_failed_write_of_the_flash_is_detected(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    board = FakeChip("f405")
    board.is_worn_out = True
    connect(monkeypatch, FakeProbe(board))
    assert main(["stm32", "flash", "--yes"]) == 3
    assert "has other bytes than were written" in capsys.readouterr().err


def test_without_a_terminal_the_option_yes_is_needed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    board = FakeChip("f405")
    connect(monkeypatch, FakeProbe(board))
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    assert main(["stm32", "flash"]) == 2
    assert "nobody can be asked here" in capsys.readouterr().err
    assert not board.erased


@pytest.fixture
def dfu(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    program = tmp_path / "dfu-util"
    program.write_text(DFU_UTIL.format(python=sys.executable))
    program.chmod(0o755)
    (tmp_path / "listed").write_text(LISTED)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    return tmp_path


def test_dfu_writes_the_image_last_and_starts_it(dfu: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["stm32", "flash", "--by", "dfu", "--yes", "--channels", "8"]) == 0
    assert (dfu / "0x08000000").read_bytes() == Path(load_image("f405").path).read_bytes()
    assert (dfu / "0x08004000").read_bytes() == parameters(8)
    assert (dfu / "log").read_text().splitlines()[1:] == [
        "-d 0483:df11 -p 1-1.2 -a 0 -s 0x08004000 -D",
        "-d 0483:df11 -p 1-1.2 -a 0 -s 0x08000000:leave -D",
    ]
    assert "board in DFU mode at 1-1.2, 1024 KiB of flash" in capsys.readouterr().out


def test_a_failure_of_dfu_util_is_reported(dfu: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (dfu / "fails").touch()
    assert main(["stm32", "flash", "--by", "dfu", "--yes"]) == 3
    assert "dfu-util: dfu-util: Error during download get_status: LIBUSB_ERROR_PIPE" in capsys.readouterr().err


def test_no_board_several_boards_and_no_dfu_util_are_reported(
    dfu: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refusal(*arguments: str) -> str:
        assert main(["stm32", "flash", "--by", "dfu", "--yes", *arguments]) == 3
        return capsys.readouterr().err

    (dfu / "listed").write_text("dfu-util 0.11\n")
    assert "no board in DFU mode (0483:df11): set BOOT0 high" in refusal()
    (dfu / "listed").write_text(LISTED + LISTED.replace("1-1.2", "1-7"))
    assert "2 boards in DFU mode: choose one with --probe PATH, of: 1-1.2 (serial 357436, 1024 KiB); 1-7" in refusal()
    assert "no board in DFU mode at '2-1'" in refusal("--probe", "2-1")
    monkeypatch.setenv("PATH", str(dfu / "empty"))
    assert "no dfu-util: sudo apt install dfu-util" in refusal()


def test_flashing_without_pyocd_names_the_extra(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Absent:
        def find_spec(self, name: str, *_: Any) -> None:
            if name.split(".", maxsplit=1)[0] == "pyocd":
                raise ModuleNotFoundError(f"No module named {name!r}", name="pyocd")

    for name in [name for name in sys.modules if name.split(".")[0] == "pyocd"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Absent(), *sys.meta_path])
    assert main(["stm32", "flash", "--yes"]) == 5
    assert "pip install 'uuv-hil[flash]'" in capsys.readouterr().err
