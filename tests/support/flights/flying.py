"""A vehicle in the pool that is commanded by the bytes of messages, without network and clock."""

from collections.abc import Callable
from typing import Any

from hil.autonomy.control.controller import Gains
from hil.client.samples import State
from hil.common.clock import NS_PER_MS, NS_PER_S, now_ns, to_wall_ns
from hil.common.schema import parse
from hil.ros import encoders as ros
from hil.slave.command_receiver import CommandReceiver
from hil.slave.pilot import Pilot
from sim.environment.world import load_world
from sim.sensors.samples import OdometrySample
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle

VEHICLE, CONTROL = load_vehicle("paper_six")
WORLD = load_world("pool")
GID = b"a" * 16


def twist(surge: float = 0.0, sway: float = 0.0, heave: float = 0.0, yaw_rate: float = 0.0) -> bytes:
    """Return a message on cmd_vel."""
    return ros.encode_twist((surge, sway, heave), (0.0, 0.0, yaw_rate))


class Bench:
    """A command receiver, a pilot and a vehicle in the pool; commands are repeated ten times a simulated second."""

    def __init__(self) -> None:
        gains = parse(CONTROL, Gains, "control")
        self.command_receiver = CommandReceiver(NS_PER_S, rate=5000.0, thrusters=6)
        self.pilot = Pilot(VEHICLE, gains, WORLD.density * WORLD.gravity, 500 * NS_PER_MS)
        self.simulation = Simulation(VEHICLE, WORLD, seed=3, position=(4.0, 4.0, 2.0))
        self.pulses: tuple[int, ...] = (1500,) * 6
        self.state = State(*self.simulation.truth())
        self._sequence = 0

    def send(self, topic: str, payload: bytes, gid: bytes = GID) -> None:
        """Pass a message to the command receiver."""
        self._sequence += 1
        stamp = ros.pack_attachment(self._sequence, to_wall_ns(now_ns()), gid)
        self.command_receiver.on_message(topic, payload, stamp)

    def fly(self, seconds: float, **messages: bytes) -> OdometrySample:
        """Repeat these messages for so long; return the true state of the vehicle at the end."""

        def command(_: State) -> None:
            for topic, payload in messages.items():
                self.send(topic, payload)

        return self.lead(seconds, command)

    def lead(self, seconds: float, command: Callable[[State], object]) -> OdometrySample:
        """Call `command` with the navigation's state ten times a second, until it returns True."""
        for step in range(round(400 * seconds)):
            if step % 40 == 0 and self._receive(command):
                break
            sample: Any
            for topic, sample in self.simulation.step(self.pulses):
                self.pilot.update_sensor(topic, sample)
                self.state = State(*sample) if topic == "odom" else self.state
            if step % 8 == 0:
                self.pulses = self.pilot.update(self.simulation.time_ns, 0.02)[0].pwm_us
        return self.simulation.truth()

    def _receive(self, command: Callable[[State], object]) -> bool:
        has_ended = command(self.state) is True
        taken = self.command_receiver.take_latest()
        if taken:
            self.pilot.set_command(taken.command, self.simulation.time_ns)
        return has_ended
