"""The firmware's C code, compiled into the slave's process to serve as its STM32.

Public: `firmware.open_firmware`. It must not repeat what firmware_stub/src has: that code is compiled here unchanged.
"""
