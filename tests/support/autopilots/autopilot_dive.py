"""Common part of dives with a real autopilot: a world with a current, a vehicle, and a ground station that commands it.

Everything happens in simulated time, in lockstep: the duration depends on the machine, the results do not.
"""

import time

from hil.autopilots.run import AutopilotRun
from hil.scenario.config import Scenario
from tests.support.clients.ground_station import GroundStation, Mission, fly

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


class AutopilotDive:
    """One autopilot with its vehicle and a ground station."""

    def __init__(self, scenario: Scenario, station: GroundStation) -> None:
        self.reports: list[str] = []
        self.run = AutopilotRun(scenario, self.reports.append)
        self.station = station
        self.start = time.monotonic()

    def close(self) -> None:
        self.station.close()
        simulated, took = self.run.simulation.time_ns / 1e9, time.monotonic() - self.start
        print(f"{simulated:.0f} s in {took:.1f} s: {simulated / took:.1f} times real time; {self.reports[1:]}")
        self.run.__exit__()

    def fly(self, mission: Mission, limit: float) -> None:
        """Fly the mission to its end, in `limit` s of simulated time, and close everything."""
        try:
            fly(self.run, self.station, mission, limit)
        finally:
            self.close()

    @property
    def position(self) -> list[float]:
        return list(self.run.simulation.state.position)

    def command(self, number: int, *parameters: float) -> Mission:
        """Send a command until it is accepted."""
        return command(self.station, number, *parameters)

    def hold(self, seconds: float, depths: list[float]) -> Mission:
        """Record the depth twenty times a second."""
        for _ in range(round(20 * seconds)):
            depths.append(self.position[2])
            yield 0.05
