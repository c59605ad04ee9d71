"""Emulator of an STM32 in this process: the core's instructions by Unicorn, the rest of the chip by these modules.

    core.py         instructions, exceptions, sleep, faults        nvic.py      which exception comes next
    models.py       the F103, F405, F411, F446: what is where      memory.py    flash, RAM
    chip.py         peripherals, clock enables, reset              system.py    the core's registers, SysTick
    peripheral.py   what a block of registers is; counting time    rcc.py       clocks
    usart.py        serial ports                                   timer.py     PWM
    bxcan.py        CAN                                            iwdg.py      watchdog

Register semantics: ST RM0090 (STM32F405), RM0008 (STM32F103) and the ARMv7-M Architecture Reference Manual.
All peripherals not named above are plain registers: they keep what is written to them.
"""
