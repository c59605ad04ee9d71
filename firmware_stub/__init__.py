"""The STM32 that drives the thrusters: firmware in C, its twin in Python, emulators, and the byte layouts (`frames/`).

`stub.py` is the specification of the behaviour; `src/` and `include/` are the firmware in C; `native.py`, `qemu.py`
and `unicorn_board.py` run it. This package uses `hil.links`, and knows nothing of the network, the scenario or the
simulator.
"""
