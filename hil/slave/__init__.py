"""The vehicle daemon on the board: the real-time loop, commands in, samples out, STM32 drivers, health.

Public: `daemon`, `pilot`. It must not know planners; the loop must never call the network.
"""
