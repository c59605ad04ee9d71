"""The fault campaign: faults of link, process, network, clock, disk, memory, peer and file, against real processes.

Each row applies one fault to one kind of thruster link, and measures at the STM32's end: `python -m tools.faults`.
"""
