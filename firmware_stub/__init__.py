"""The STM32 that drives the thrusters: firmware in C, its model in Python, emulators, and the byte layouts (`frames/`).

Public: `stub.py`, the specification of the behaviour; `src/` and `include/`, the firmware in C; `native.py` and
`unicorn_board.py`, which run it; also `child`, `image`, `serve`. It uses `hil.links`, and must not know the network,
the scenario or the simulator.
"""
