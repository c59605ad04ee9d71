"""Drivers of the STM32: one in the slave's own process, or one at the far end of a link.

Public: `driver.open_driver` and the interface `driver.ThrusterDriver`; `ends`, the ends of a thruster link. It must not
know the loop, the controller or the simulator.
"""
