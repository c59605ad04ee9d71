"""Drivers of the STM32: one in the slave's own process, or one at the far end of a link."""
