"""The STM32 that drives the thrusters: its behaviour in Python, and the byte layouts it speaks (`frames/`)."""
