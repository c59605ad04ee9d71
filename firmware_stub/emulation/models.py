"""The emulated chips: addresses, clocks and interrupts of the peripherals, and the memory.

Addresses and interrupt numbers: RM0090, tables 1 and 62 (F405), RM0383 (F411), RM0390 (F446), RM0008 (F103). Enable
bits: their sections on the RCC. F411, F446 and F103 have only the peripherals that a thruster program may use.
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
    """A type of STM32. usarts, timers: interrupt numbers by name. ram: sizes by address. device_id: DEV_ID.

    apb2_enable: offset of the register that enables the peripherals of the faster bus. Sizes are in bytes.
    """

    name: str
    family: str
    device_id: int
    peripherals: dict[str, Place]
    usarts: dict[str, int]
    timers: dict[str, int]
    apb2_enable: int
    flash_size: int
    ram: dict[int, int]


F405_PLACES = {
    **{f"TIM{2 + i}": Place(0x4000_0000 + BLOCK * i, APB1ENR, i) for i in range(6)},
    **{f"TIM{12 + i}": Place(0x4000_1800 + BLOCK * i, APB1ENR, 6 + i) for i in range(3)},
    "RTC": Place(0x4000_2800), "WWDG": Place(0x4000_2C00, APB1ENR, 11), "IWDG": Place(0x4000_3000),
    "I2S2EXT": Place(0x4000_3400, APB1ENR, 14), "SPI2": Place(0x4000_3800, APB1ENR, 14),
    "SPI3": Place(0x4000_3C00, APB1ENR, 15), "I2S3EXT": Place(0x4000_4000, APB1ENR, 15),
    "USART2": Place(0x4000_4400, APB1ENR, 17), "USART3": Place(0x4000_4800, APB1ENR, 18),
    "UART4": Place(0x4000_4C00, APB1ENR, 19), "UART5": Place(0x4000_5000, APB1ENR, 20),
    "I2C1": Place(0x4000_5400, APB1ENR, 21), "I2C2": Place(0x4000_5800, APB1ENR, 22),
    "I2C3": Place(0x4000_5C00, APB1ENR, 23),
    "CAN1": Place(0x4000_6400, APB1ENR, 25), "CAN2": Place(0x4000_6800, APB1ENR, 26),
    "PWR": Place(0x4000_7000, APB1ENR, 28), "DAC": Place(0x4000_7400, APB1ENR, 29),
    "TIM1": Place(0x4001_0000, APB2ENR, 0), "TIM8": Place(0x4001_0400, APB2ENR, 1),
    "USART1": Place(0x4001_1000, APB2ENR, 4), "USART6": Place(0x4001_1400, APB2ENR, 5),
    "ADC": Place(0x4001_2000), "SDIO": Place(0x4001_2C00, APB2ENR, 11), "SPI1": Place(0x4001_3000, APB2ENR, 12),
    "SYSCFG": Place(0x4001_3800, APB2ENR, 14), "EXTI": Place(0x4001_3C00),
    **{f"TIM{9 + i}": Place(0x4001_4000 + BLOCK * i, APB2ENR, 16 + i) for i in range(3)},
    **{f"GPIO{'ABCDEFGHI'[i]}": Place(0x4002_0000 + BLOCK * i, AHB1ENR, i) for i in range(9)},
    "CRC": Place(0x4002_3000, AHB1ENR, 12), "RCC": Place(0x4002_3800), "FLASH": Place(0x4002_3C00),
    "BKPSRAM": Place(0x4002_4000, AHB1ENR, 18),
    "DMA1": Place(0x4002_6000, AHB1ENR, 21), "DMA2": Place(0x4002_6400, AHB1ENR, 22),
}  # fmt: skip
TIMERS = {"TIM1": 25, "TIM2": 28, "TIM3": 29, "TIM4": 30, "TIM5": 50}
RAM = 0x2000_0000
F405 = Model(
    "f405", "f4", 0x413, F405_PLACES,
    {"USART1": 37, "USART2": 38, "USART3": 39, "UART4": 52, "UART5": 53, "USART6": 71},
    TIMERS | {"TIM6": 54, "TIM7": 55, "TIM8": 44},
    APB2ENR, 1024 * KIB, {RAM: 128 * KIB, 0x1000_0000: 64 * KIB},
)  # fmt: skip


def _without(*names: str) -> dict[str, Place]:
    return {name: place for name, place in F405_PLACES.items() if name not in names}


F411 = Model(
    "f411", "f4", 0x431,
    _without(
        "CAN1", "CAN2", "USART3", "UART4", "UART5", "TIM6", "TIM7", "TIM8", "TIM12", "TIM13", "TIM14", "DAC", "GPIOF",
        "GPIOG", "GPIOI", "BKPSRAM",
    ),
    {"USART1": 37, "USART2": 38, "USART6": 71}, TIMERS, APB2ENR, 512 * KIB, {RAM: 128 * KIB},
)  # fmt: skip
F446 = F405._replace(
    name="f446", device_id=0x421, peripherals=_without("GPIOI"), flash_size=512 * KIB, ram={RAM: 128 * KIB}
)
F103_PLACES = {
    **{f"TIM{2 + i}": Place(0x4000_0000 + BLOCK * i, F1_APB1ENR, i) for i in range(3)},
    "RTC": Place(0x4000_2800), "WWDG": Place(0x4000_2C00, F1_APB1ENR, 11), "IWDG": Place(0x4000_3000),
    "SPI2": Place(0x4000_3800, F1_APB1ENR, 14),
    "USART2": Place(0x4000_4400, F1_APB1ENR, 17), "USART3": Place(0x4000_4800, F1_APB1ENR, 18),
    "I2C1": Place(0x4000_5400, F1_APB1ENR, 21), "I2C2": Place(0x4000_5800, F1_APB1ENR, 22),
    "CAN1": Place(0x4000_6400, F1_APB1ENR, 25), "PWR": Place(0x4000_7000, F1_APB1ENR, 28),
    "AFIO": Place(0x4001_0000, F1_APB2ENR, 0), "EXTI": Place(0x4001_0400),
    **{f"GPIO{'ABCDE'[i]}": Place(0x4001_0800 + BLOCK * i, F1_APB2ENR, 2 + i) for i in range(5)},
    "ADC": Place(0x4001_2400, F1_APB2ENR, 9), "TIM1": Place(0x4001_2C00, F1_APB2ENR, 11),
    "SPI1": Place(0x4001_3000, F1_APB2ENR, 12), "USART1": Place(0x4001_3800, F1_APB2ENR, 14),
    "DMA1": Place(0x4002_0000), "RCC": Place(0x4002_1000), "FLASH": Place(0x4002_2000), "CRC": Place(0x4002_3000),
}  # fmt: skip
F103 = Model(
    "f103", "f1", 0x410, F103_PLACES, {"USART1": 37, "USART2": 38, "USART3": 39},
    {"TIM1": 25, "TIM2": 28, "TIM3": 29, "TIM4": 30}, F1_APB2ENR, 64 * KIB, {RAM: 20 * KIB},
)  # fmt: skip

MODELS = {model.name: model for model in (F103, F405, F411, F446)}
