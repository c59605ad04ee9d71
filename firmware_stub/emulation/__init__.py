"""Emulator of an STM32 in this process: the core's instructions by Unicorn, the rest of the chip by these modules.

    core.py         exceptions, sleep                              engine.py    instructions, faults
    nvic.py         choice of the next exception                   memory.py    flash, RAM
    models.py       F103, F405, F411, F446: addresses, memory      system.py    SysTick, enables of interrupts
    chip.py         peripherals, clock enables, reset              rcc.py       clocks
    peripheral.py   base classes of registers and time             timer.py     PWM
    usart.py        serial ports                                   iwdg.py      watchdog
    bxcan.py        CAN

Register semantics: ST RM0090 (STM32F405), RM0008 (STM32F103) and the ARMv7-M Architecture Reference Manual. Only what
our firmware uses is modelled: an access to anything else is a fault, not a silent difference from the chip.

Public: `core.Core` and `chip.Chip`, which firmware_stub/unicorn_board.py runs. It must not know what the firmware does,
nor thruster messages.
"""
