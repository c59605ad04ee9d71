"""Emulator of an STM32 in this process: the core's instructions by Unicorn, the rest of the chip by these modules.

    core.py         instructions, exceptions, sleep, faults        nvic.py      choice of the next exception
    models.py       F103, F405, F411, F446: addresses, memory      memory.py    flash, RAM
    chip.py         peripherals, clock enables, reset              system.py    the core's registers, SysTick
    peripheral.py   base classes of registers and time             rcc.py       clocks
    usart.py        serial ports                                   timer.py     PWM
    bxcan.py        CAN                                            iwdg.py      watchdog

Register semantics: ST RM0090 (STM32F405), RM0008 (STM32F103) and the ARMv7-M Architecture Reference Manual.
All other peripherals are plain registers, which store what is written to them.

Public: `core.Core` and `chip.Chip`, which firmware_stub/unicorn_board.py runs. It must not know what the firmware does,
nor thruster messages.
"""
