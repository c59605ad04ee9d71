"""Control by fins: moment allocation, loops against the simulator, and a mission across open water."""

from collections.abc import Callable
from math import copysign, radians

import pytest

from hil.autonomy.control.controller import Gains, Navigation, VelocityCommand
from hil.autonomy.control.fin_control import FinAllocator, FinController, FinGains
from hil.scenario.config import build_simulation, load_scenario
from hil.slave.pilot import Pilot, build_pilot
from sim.environment.world import load_world
from sim.rotations import from_euler, to_euler
from sim.simulation import Simulation
from sim.vehicle.fins import fin_matrix
from sim.vehicle.vehicle import load_vehicle

TORPEDOES = ("remus100", "lauv", "eca_a9", "tethys")
OPEN = load_world("open_water")._replace(cylinder=(), box=())
STEP = 0.01


# -- sharing ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["lauv", "eca_a9"])
def test_four_fins_produce_any_small_moment(name: str) -> None:
    fins = load_vehicle(name)[0].fins
    matrix = fin_matrix(fins, 1025.0)
    allocator = FinAllocator(matrix, [fin.max_deflection for fin in fins], 0.5)
    for speed in (0.8, 2.0, -1.0):
        expected = (7.0, 0.0, 0.0, 0.02, -0.3, 0.4)
        angles, residual = allocator.allocate(expected, speed)
        assert residual == (7.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # the propeller's residual is not that of the fins
        pressure = copysign(speed * speed, speed)
        made = [pressure * sum(a * b for a, b in zip(row, angles, strict=True)) for row in matrix]
        assert made[3:] == pytest.approx(expected[3:], rel=1e-4)


def test_moments_that_fins_cannot_produce_are_the_residual() -> None:
    fins = load_vehicle("remus100")[0].fins
    matrix = fin_matrix(fins, 1025.0)
    allocator = FinAllocator(matrix, [fin.max_deflection for fin in fins], 0.5)
    angles, residual = allocator.allocate((0.0, 0.0, 0.0, 0.5, 0.0, 100.0), 1.0)
    assert angles[0] == pytest.approx(radians(20.0))
    assert residual[3] == pytest.approx(0.5)  # a rudder and planes on the axis give no roll
    assert residual[5] == pytest.approx(100.0 - matrix[5][0] * radians(20.0))
    slow, _ = allocator.allocate((0.0, 0.0, 0.0, 0.0, 0.0, 0.1), 0.0)
    least, _ = allocator.allocate((0.0, 0.0, 0.0, 0.0, 0.0, 0.1), 0.5)
    assert slow == least


def controller() -> FinController:
    return FinController(Gains(), FinGains(pitch_limit=0.3, least_speed=0.6), (30.0, 60.0, 60.0, 0.2, 8.0, 8.0))


def navigation(u: float, pitch: float = 0.0, w: float = 0.0) -> Navigation:
    return Navigation(from_euler(0.0, pitch, 0.0), (0.0, 0.0, 0.0), (u, 0.0, w), 10.0)


def test_a_fin_vehicle_keeps_moving_while_it_steers_and_stops_on_command() -> None:
    going = controller().update(VelocityCommand(surge=0.1, yaw_rate=0.1), navigation(0.3), 0.02)
    least = controller().update(VelocityCommand(surge=0.6, yaw_rate=0.1), navigation(0.3), 0.02)
    stopping = controller().update(VelocityCommand(), navigation(0.3), 0.02)
    assert going == least
    assert stopping[0] < 0.0 < going[0]
    assert going[1:3] == (0.0, 0.0)


def test_a_fin_vehicle_dives_bow_down_ahead_and_bow_up_astern() -> None:
    for u, sign in ((1.5, -1.0), (-1.5, 1.0)):
        pitching = controller().update(VelocityCommand(surge=u, heave=0.3), navigation(u), 0.02)[4]
        assert copysign(1.0, pitching) == sign
        steep = controller().update(VelocityCommand(surge=u, heave=9.0), navigation(u, sign * 0.31), 0.02)[4]
        assert copysign(1.0, steep) == -sign  # beyond its limit already


# -- in the water -------------------------------------------------------------------------------------------------


def fly(name: str, seconds: float, command: Callable[[float], VelocityCommand]) -> tuple[Simulation, Pilot]:
    scenario = load_scenario("open_water", {"vehicle": name, "start.heading": 0.0, "slave.step": STEP})
    vehicle, control = load_vehicle(name)
    simulation, pilot = build_simulation(scenario, vehicle, OPEN), build_pilot(scenario, vehicle, control, OPEN)
    for step in range(round(seconds / STEP)):
        if step % 2 == 0:
            pilot.set_command(command(step * STEP), simulation.time_ns)
            pulses, _ = pilot.update(simulation.time_ns, 2 * STEP)
        for topic, sample in simulation.step(pulses.pwm_us):
            pilot.update_sensor(topic, sample)
    return simulation, pilot


@pytest.mark.parametrize("name", TORPEDOES)
def test_speed_heading_and_depth_are_reached_together(name: str) -> None:
    """The vehicle reaches 1 m/s, a quarter turn and 3 m deeper, measured with noise and a gyro's turn-on error."""
    simulation, _ = fly(name, 90.0, lambda t: VelocityCommand(surge=1.0, heading=1.5, depth=8.0))
    roll, pitch, yaw = to_euler(simulation.state.quaternion)
    assert simulation.state.nu[0] == pytest.approx(1.0, abs=0.05)
    assert yaw == pytest.approx(1.5, abs=0.05)
    assert simulation.state.position[2] == pytest.approx(8.0, abs=0.25)
    assert abs(roll) < 0.05
    assert abs(pitch) < 0.05


@pytest.mark.parametrize("name", TORPEDOES)
def test_a_turn_rate_is_reached(name: str) -> None:
    simulation, _ = fly(name, 40.0, lambda t: VelocityCommand(surge=1.0, yaw_rate=0.06, depth=5.0))
    assert simulation.state.nu[5] == pytest.approx(0.06, abs=0.015)
    assert simulation.state.position[2] == pytest.approx(5.0, abs=0.3)


def test_idle_channels_are_neutral_and_drop_weights_are_not_released() -> None:
    simulation, pilot = fly("tethys", 2.0, lambda t: VelocityCommand(surge=1.0, yaw_rate=0.05))
    command, _ = pilot.update(simulation.time_ns, 0.02)
    assert len(command.pwm_us) == 5
    assert command.pwm_us[3:] == (1500, 1500)
    assert command.pwm_us[1] != 1500
    stopped, _ = pilot.update(simulation.time_ns + 10**9, 0.02)  # the deadman
    assert stopped.pwm_us == (1500,) * 5
    assert simulation.vehicle.mass == load_vehicle("tethys")[0].mass
