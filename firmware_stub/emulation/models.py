"""The emulated chips: their memory, and the addresses and clocks of the peripherals that the firmware uses.

Addresses: RM0090, table 1 (F405), RM0383 (F411), RM0390 (F446), RM0008 (F103). Enable bits: their sections on the RCC.
An access to any other peripheral is a fault.
"""

from typing import NamedTuple

BLOCK = 0x400
AHB1ENR, APB1ENR, APB2ENR = 0x30, 0x40, 0x44  # of the F4's RCC
F1_APB2ENR, F1_APB1ENR = 0x18, 0x1C
KIB = 1024


class Place(NamedTuple):
    """Address of a peripheral, and the register and bit of the RCC that enable its clock (register 0: always on)."""

    address: int
    register: int = 0
    bit: int = 0


class Model(NamedTuple):
    """A type of STM32. ram: sizes by address. device_id: DEV_ID. usart: the host's serial port, as in src/*/chip.h.

    Sizes are in bytes.
    """

    name: str
    family: str
    device_id: int
    peripherals: dict[str, Place]
    usart: str
    flash_size: int
    ram: dict[int, int]


F405_PLACES = {
    "TIM3": Place(0x4000_0400, APB1ENR, 1), "TIM4": Place(0x4000_0800, APB1ENR, 2), "IWDG": Place(0x4000_3000),
    "USART2": Place(0x4000_4400, APB1ENR, 17), "CAN1": Place(0x4000_6400, APB1ENR, 25),
    "USART1": Place(0x4001_1000, APB2ENR, 4),
    **{f"GPIO{'ABC'[i]}": Place(0x4002_0000 + BLOCK * i, AHB1ENR, i) for i in range(3)},
    "RCC": Place(0x4002_3800), "FLASH": Place(0x4002_3C00),
}  # fmt: skip
RAM = 0x2000_0000
F405 = Model("f405", "f4", 0x413, F405_PLACES, "USART1", 1024 * KIB, {RAM: 128 * KIB, 0x1000_0000: 64 * KIB})
F446 = Model("f446", "f4", 0x421, F405_PLACES, "USART2", 512 * KIB, {RAM: 128 * KIB})
F411_PLACES = {name: place for name, place in F405_PLACES.items() if name != "CAN1"}
F411 = Model("f411", "f4", 0x431, F411_PLACES, "USART2", 512 * KIB, {RAM: 128 * KIB})
F103_PLACES = {
    "TIM3": Place(0x4000_0400, F1_APB1ENR, 1), "TIM4": Place(0x4000_0800, F1_APB1ENR, 2), "IWDG": Place(0x4000_3000),
    "CAN1": Place(0x4000_6400, F1_APB1ENR, 25), "USART1": Place(0x4001_3800, F1_APB2ENR, 14),
    **{f"GPIO{'ABC'[i]}": Place(0x4001_0800 + BLOCK * i, F1_APB2ENR, 2 + i) for i in range(3)},
    "RCC": Place(0x4002_1000), "FLASH": Place(0x4002_2000),
}  # fmt: skip
F103 = Model("f103", "f1", 0x410, F103_PLACES, "USART1", 64 * KIB, {RAM: 20 * KIB})

MODELS = {model.name: model for model in (F103, F405, F411, F446)}
