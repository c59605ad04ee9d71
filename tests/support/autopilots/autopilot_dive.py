"""Common part of dives with a real autopilot: a world with a current, and commands repeated until they are accepted."""

from tests.support.clients.ground_station import GroundStation, Mission

WORLD = """
name = "stream"
source = "made up"
extent = [-100.0, 100.0, -100.0, 100.0]
depth = 30.0
origin = [50.0, 8.0]
magnetic_field = [49e-6, 1.15, 0.06]
current = [0.3, 0.0, 0.0]
"""
ARM, SET_MODE = 400, 176  # MAV_CMD_COMPONENT_ARM_DISARM, MAV_CMD_DO_SET_MODE


def command(station: GroundStation, number: int, *parameters: float) -> Mission:
    """Send a command twice a second until it is accepted, 200 times at most."""
    for _ in range(200):
        station.command(number, *parameters)
        yield 0.5
        if station.acks.get(number) == 0:
            return
    raise AssertionError(f"command {number} {parameters}: {station.acks}, {station.texts[-5:]}")
