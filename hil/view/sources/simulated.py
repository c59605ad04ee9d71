"""Samples of a simulation in this process, for the live view. Its time can be paused, stepped and sped up."""

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from hil.common.clock import NS_PER_S, now_ns
from hil.ros.diagnostics import Diagnostics
from hil.ros.dvl import altitude_of
from hil.ros.images import Picture
from hil.ros.joints import JointStates
from hil.ros.topics import first_of
from hil.view.sources.paced_time import PacedTime
from hil.view.sources.source import Source
from sim.simulation import Simulation

IMAGES = ("forward_sonar", "side_scan")
WAIT_S = 0.005  # one wait of a step for its time
UPDATE_NS = NS_PER_S // 20


class SimulatedVehicle(Protocol):
    """A vehicle in simulated time: hil.cases.simulated.SimulatedVehicle, hil.autopilots.run.AutopilotRun."""

    simulation: Simulation
    samples: dict[str, Any]
    pwm_us: tuple[int, ...]


class SimulatedSource(Source):
    """The vehicles of a simulation by name, all with the same simulation time."""

    def __init__(self, vehicles: Mapping[str, SimulatedVehicle]) -> None:
        self._vehicles = vehicles
        self.playback: PacedTime = PacedTime()

    @property
    def names(self) -> list[str]:
        """Names of the vehicles, sorted."""
        return sorted(self._vehicles)

    def is_present(self, name: str) -> bool:
        """Return True, as a simulated vehicle is always present."""
        return True

    def latest(self, name: str) -> Mapping[str, Any]:
        """Return the newest sample of each sensor, the ground truth, and the thrusts (N)."""
        vehicle = self._vehicles[name]
        simulation = vehicle.simulation
        newest: dict[str, Any] = {"ground_truth": simulation.truth()}
        for topic, sample in vehicle.samples.items():
            first = first_of(topic)
            if first == "camera":
                picture = Picture(sample.time_ns, sample.width, sample.height, "rgb8", sample.rgb)
                newest[f"{topic}/image_raw"] = picture
            elif first in IMAGES:
                newest[f"{topic}/image"] = sample
            else:
                newest[topic] = sample
                if topic == "dvl":  # a slave publishes the altitude as a separate topic
                    newest["altitude"] = altitude_of(sample)
        if simulation.tether:
            newest["tether"] = tuple(simulation.tether.nodes)
        names = tuple([thruster.name for thruster in simulation.vehicle.thrusters])
        newest["joint_states"] = JointStates(simulation.time_ns, names, tuple(simulation.thrusts))
        return newest

    def diagnostics(self, name: str) -> Diagnostics:
        """Return pulse widths and contacts; a simulation without a slave has no other diagnostics."""
        figures, vehicle = Diagnostics(), self._vehicles[name]
        figures.pwm_us = tuple(vehicle.pwm_us)
        figures.contacts = vehicle.simulation.contacts
        autopilot = getattr(vehicle, "autopilot", None)
        if autopilot and autopilot.estimate:
            autopilot.estimate.add_figures(figures)
        return figures

    def pace(self, update: Callable[[], None], wait: Callable[[float], None]) -> Callable[[Any], None]:
        """Return a function that delays each step of a flight until its time.

        While it waits it calls `update` 20 times a second.
        """
        due_ns = 0

        def step(vehicle: Any) -> None:
            nonlocal due_ns
            while True:
                if now_ns() >= due_ns:
                    due_ns = now_ns() + UPDATE_NS
                    update()
                if self.playback.time * NS_PER_S >= vehicle.simulation.time_ns:
                    return
                wait(WAIT_S)

        return step
