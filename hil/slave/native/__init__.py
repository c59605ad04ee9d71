"""The firmware's C code, compiled into the slave's process to serve as its STM32."""
