"""Run each motor of a frame alone in the simulation, and report the direction in which the vehicle moves."""

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
    """Result of a motor test with a pulse width above neutral.

    `number`: of the motor, from 1. `thruster`: name of the thruster that ran. `push`: directions in which the vehicle
    moved. `expected`: directions by the frame, "" for a custom one. `agrees`: both are the same.
    """

    number: int
    thruster: str
    mirrored: bool
    push: str
    expected: str
    agrees: bool


def test_motors(scenario: Scenario, vehicle: Vehicle, motors: MotorMap) -> list[MotorResult]:
    """Return the result of each motor. Raises ConfigError."""
    at_rest = _velocity_after(scenario, vehicle, motors.neutral)
    rows = None if motors.frame == CUSTOM else load_frame(motors.frame).wrenches()
    results = []
    for output, channel, sign in motors.motors:
        if channel >= len(vehicle.thrusters):
            continue  # a fin or a drop weight
        widths = [PWM_NEUTRAL_US] * OUTPUTS
        widths[output] = WIDTH_US
        moved = _velocity_after(scenario, vehicle, motors.pulses(widths))
        push = [a - b for a, b in zip(moved, at_rest, strict=True)]
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


def _velocity_after(scenario: Scenario, vehicle: Vehicle, pulses: Sequence[int]) -> list[float]:
    """Return the velocities (m/s, rad/s, FRD) after TEST_NS from rest with these pulse widths."""
    simulation = build_simulation(scenario, vehicle, load_world(scenario.world))
    while simulation.time_ns < TEST_NS:
        simulation.step(tuple(pulses))
    return list(simulation.state.nu)


def _agrees(row: Sequence[float], push: Sequence[float]) -> bool:
    """Return whether forces and torques have the same direction; one that a row does not have is not compared."""
    products = [sum(a * b for a, b in zip(row[part], push[part], strict=True)) for part in (slice(0, 3), slice(3, 6))]
    return all(product > 0.0 for product, part in zip(products, (row[:3], row[3:]), strict=True) if any(part))
