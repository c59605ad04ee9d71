"""The fault campaign: faults of links, processes, machines, addresses, drivers and files, against real processes.

Each row applies one fault to one kind of thruster link, and measures at the STM32's end: `python -m tools.faults`.
"""
