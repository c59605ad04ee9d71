"""Emulator of an STM32F405 in this process: the core's instructions by Unicorn, the rest of the chip by these modules.

    core.py         instructions, exceptions, sleep, faults        nvic.py      which exception comes next
    chip.py         memory map, peripherals, reset                 system.py    the core's registers, SysTick
    peripheral.py   what a block of registers is; counting time    rcc.py       clocks
    usart.py        serial ports                                   timer.py     PWM
    bxcan.py        CAN                                            iwdg.py      watchdog

Register semantics: ST RM0090 (STM32F405/415 reference manual) and the ARMv7-M Architecture Reference Manual.
All peripherals not named above are plain registers: they keep what is written to them.
"""
