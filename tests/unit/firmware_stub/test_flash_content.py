"""A board gets the right image by the chip's own number, or is refused with both named."""

from pathlib import Path

import pytest

from firmware_stub.flash import dfu
from firmware_stub.flash.content import choose_image, load_content
from firmware_stub.image import CHIPS, load_image, parameters
from hil.common.errors import ConfigError, DeviceError

# As dfu-util 0.11 prints it, of a board with an F405.
LISTED = """\
dfu-util 0.11

Copyright 2005-2009 Weston Schmidt, Harald Welte and OpenMoko Inc.
Copyright 2010-2021 Tormod Volden and Stefan Schmidt
This program is Free Software and has ABSOLUTELY NO WARRANTY
Please report bugs to http://sourceforge.net/p/dfu-util/tickets/

Found DFU: [0483:df11] ver=2200, devnum=12, cfg=1, intf=0, path="1-1.2", alt=2, name="@OTP Memory /0x1FFF7800/01*512 e,01*016 e", serial="357436"
Found DFU: [0483:df11] ver=2200, devnum=12, cfg=1, intf=0, path="1-1.2", alt=1, name="@Option Bytes  /0x1FFFC000/01*016 e", serial="357436"
Found DFU: [0483:df11] ver=2200, devnum=12, cfg=1, intf=0, path="1-1.2", alt=0, name="@Internal Flash  /0x08000000/04*016Kg,01*064Kg,07*128Kg", serial="357436"
Found DFU: [1d50:6017] ver=0110, devnum=13, cfg=1, intf=4, path="1-1.3", alt=0, name="Black Magic Firmware Upgrade", serial="7BB1"
"""  # noqa: E501
F405, HALF = dfu.DfuBoard("1-1.2", "357436", 1024), dfu.DfuBoard("1-4", "A", 512)


@pytest.mark.parametrize("chip", CHIPS)
def test_the_chips_number_selects_the_image(chip: str) -> None:
    image = load_image(chip)
    assert choose_image(image.device_ids[0], None) == choose_image(image.device_ids[0], chip) == image


@pytest.mark.parametrize(
    ("device_id", "chip", "refusal"),
    [
        (
            0x431,
            "f405",
            r"an STM32F411 \(device id 0x431\), and the image is for an STM32F405: --chip f411",
        ),
        (0x419, None, r"an STM32F42x or F43x \(device id 0x419\), and there is no image for it; there are images"),
        (0x7FF, "f405", r"an unknown chip \(device id 0x7ff\)"),
    ],
)
def test_a_chip_that_does_not_match_is_refused_with_its_name(device_id: int, chip: str | None, refusal: str) -> None:
    with pytest.raises(ConfigError, match=refusal):
        choose_image(device_id, chip)


def test_parameters_are_written_after_the_image() -> None:
    image = load_image("f103")
    alone, both = load_content(image, None), load_content(image, parameters(4))
    assert [(address, len(data)) for address, data in alone.pieces] == [(0x0800_0000, image.size)]
    assert both.pieces[1] == (0x0800_4000, parameters(4))


def test_a_damaged_image_is_not_written(tmp_path: Path) -> None:
    image = load_image("f103")
    path = tmp_path / "image.bin"
    path.write_bytes(Path(image.path).read_bytes()[:-1])
    with pytest.raises(DeviceError, match=r"image\.bin: damaged"):
        load_content(image._replace(path=str(path)), None)
    with pytest.raises(DeviceError, match="No such file"):
        load_content(image._replace(path=str(tmp_path / "none.bin")), None)


def test_boards_in_dfu_mode_are_read_from_dfu_utils_list() -> None:
    assert dfu.parse_list(LISTED) == [F405]
    assert dfu.parse_list("dfu-util 0.11\n") == []


@pytest.mark.parametrize(
    ("board", "chip", "name"), [(F405, None, "f405"), (F405, "f405", "f405"), (HALF, "f446", "f446")]
)
def test_the_flash_size_narrows_the_choice_of_image(board: dfu.DfuBoard, chip: str | None, name: str) -> None:
    assert dfu.choose_image(board, chip).name == name


@pytest.mark.parametrize(
    ("board", "chip", "refusal"),
    [
        (HALF, None, "has 512 KiB of flash: say which chip it is, as DFU does not: --chip f411 or --chip f446"),
        (HALF, "f405", "has 512 KiB of flash, and an STM32F405 has 1024: not the image for it"),
        (F405, "f103", "an STM32F103 has no USB bootloader in its ROM: use a debug probe: --by probe"),
        (HALF._replace(flash_kib=256), None, "has 256 KiB of flash: there is no image for it"),
    ],
)
def test_a_dfu_board_that_does_not_match_is_refused(board: dfu.DfuBoard, chip: str | None, refusal: str) -> None:
    with pytest.raises(ConfigError, match=refusal):
        dfu.choose_image(board, chip)
