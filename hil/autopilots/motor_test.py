"""Turn each motor of a frame alone in the simulation, and report which way the vehicle goes."""

from collections.abc import Sequence
from typing import NamedTuple

from hil.autopilots.frames import CUSTOM, MotorMap, load_frame, push_text
from hil.common.clock import NS_PER_S
from hil.links.contract import PWM_NEUTRAL_US
from hil.scenario.config import Scenario, build_simulation
from sim.environment.world import load_world
from sim.vehicle.vehicle import Vehicle

WIDTH_US = 1700
TEST_NS = NS_PER_S // 4
OUTPUTS = 16


class MotorResult(NamedTuple):
    """Result of a motor test: motor `number` (from 1) turned `thruster`, and the vehicle went `push`.

    The pulse width of the test is above neutral. `expected` is where it goes by the frame, "" for a custom one;
    `agrees` is whether it did.
    """

    number: int
    thruster: str
    mirrored: bool
    push: str
    expected: str
    agrees: bool


def test_motors(scenario: Scenario, vehicle: Vehicle, motors: MotorMap) -> list[MotorResult]:
    """Return what each motor does. Raises ConfigError."""
    rest = _moved(scenario, vehicle, motors.neutral)
    rows = None if motors.frame == CUSTOM else load_frame(motors.frame).wrenches()
    results = []
    for output, channel, sign in motors.motors:
        if channel >= len(vehicle.thrusters):
            continue  # a fin or a weight is no motor
        widths = [PWM_NEUTRAL_US] * OUTPUTS
        widths[output] = WIDTH_US
        moved = _moved(scenario, vehicle, motors.pulses(widths))
        push = [a - b for a, b in zip(moved, rest, strict=True)]
        row = rows[output] if rows else None
        results.append(
            MotorResult(
                output + 1,
                vehicle.thrusters[channel].name,
                sign < 0,
                push_text(push),
                push_text(row) if row else "",
                row is None or _agrees(row, push),
            )
        )
    return results


def _moved(scenario: Scenario, vehicle: Vehicle, pulses: Sequence[int]) -> list[float]:
    """Return the velocities (m/s, rad/s, FRD) after a quarter of a second from rest under these pulse widths."""
    simulation = build_simulation(scenario, vehicle, load_world(scenario.world))
    while simulation.time_ns < TEST_NS:
        simulation.step(tuple(pulses))
    return list(simulation.state.nu)


def _agrees(row: Sequence[float], push: Sequence[float]) -> bool:
    """Return whether forces and torques go the same way; a row without one of them shows nothing of it."""
    products = [sum(a * b for a, b in zip(row[part], push[part], strict=True)) for part in (slice(0, 3), slice(3, 6))]
    return all(product > 0.0 for product, part in zip(products, (row[:3], row[3:]), strict=True) if any(part))
