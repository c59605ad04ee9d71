"""The firmware's own C, compiled into the slave's process as its STM32."""
