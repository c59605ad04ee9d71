"""The vehicle's computer: deadman, disarming, and a closed loop with the simulator."""

from math import cos, pi, sin

import pytest

from hil.autonomy.control.controller import Gains, Navigation, VelocityCommand
from hil.common.clock import NS_PER_MS
from hil.common.errors import ConfigError
from hil.common.schema import parse
from hil.links.contract import ThrusterCommand
from hil.scenario.config import load_scenario
from hil.slave.pilot import Pilot, _drags, build_pilot
from hil.slave.plant_model import plant_of
from hil.slave.setpoints import Setpoint, ThrustSetpoint, WrenchSetpoint
from sim.environment.seawater.pressure import ATMOSPHERE_PA, pressure_at
from sim.environment.world import load_world
from sim.rotations import from_euler, multiply, rotate_inverse
from sim.sensors.mounting import Mounting
from sim.sensors.samples import ImuSample, OdometrySample, PressureSample
from sim.simulation import Simulation
from sim.vehicle.thrusters.bank import SteadyThrusts
from sim.vehicle.thrusters.model import Azimuth
from sim.vehicle.vehicle import load_vehicle, mass_matrix

VEHICLE, CONTROL = load_vehicle("paper_six")
WORLD = load_world("pool")
NEUTRAL = (1500,) * 6


def new_pilot(deadman_ms: int = 500) -> Pilot:
    gains = parse(CONTROL, Gains, "control")
    return Pilot(VEHICLE, gains, WORLD.density * WORLD.gravity, deadman_ms * NS_PER_MS)


def test_the_deadman_trips_once_and_a_command_ends_it() -> None:
    pilot = new_pilot()
    assert pilot.update(0, 0.02) == (ThrusterCommand(1, False, NEUTRAL), False), "before the first command"
    pilot.set_command(VelocityCommand(surge=1.0), now=0)
    command, tripped = pilot.update(500 * NS_PER_MS, 0.02)
    assert command.armed
    assert command.pwm_us != NEUTRAL
    assert not tripped
    command, tripped = pilot.update(500 * NS_PER_MS + 1, 0.02)
    assert (command.armed, command.pwm_us, tripped) == (False, NEUTRAL, True)
    command, tripped = pilot.update(600 * NS_PER_MS, 0.02)
    assert (command.armed, command.pwm_us, tripped) == (False, NEUTRAL, False)
    pilot.set_command(VelocityCommand(surge=1.0), now=700 * NS_PER_MS)
    assert pilot.update(700 * NS_PER_MS, 0.02)[0].armed
    assert pilot.deadman_trips == 1


def test_open_loop_setpoints_leave_no_integral_to_the_next_velocity_command() -> None:
    velocity, fastest = VelocityCommand(surge=0.5, heave=-0.3), VelocityCommand(surge=9.0, sway=5.0, yaw_rate=5.0)

    def pulses(*commands: Setpoint) -> tuple[int, ...]:
        pilot = new_pilot(deadman_ms=60_000)
        for command in commands:
            pilot.set_command(command, now=0)
            pwm = pilot.update(0, 0.02)[0].pwm_us
        return pwm

    assert pulses(*[velocity] * 50) != pulses(velocity)
    for open_loop in (WrenchSetpoint((20.0, 0.0, 0.0, 0.0, 0.0, 0.0)), ThrustSetpoint((5.0,) * 6)):
        for before in (velocity, fastest):  # the second asks for more than the thrusters can give
            assert pulses(*[before] * 50, open_loop, velocity) == pulses(velocity)


def test_a_command_after_a_deadman_trip_starts_without_the_integral_of_before() -> None:
    first, later = (new_pilot() for _ in range(2))
    velocity = VelocityCommand(surge=0.5, heave=-0.3)
    for pilot, before in ((first, 0), (later, 50)):
        for _ in range(before):
            pilot.set_command(VelocityCommand(surge=9.0, sway=5.0, yaw_rate=5.0), now=0)
            pilot.update(0, 0.02)
        pilot.update(900 * NS_PER_MS, 0.02)  # it trips, if it was active
        pilot.set_command(velocity, now=1000 * NS_PER_MS)
    assert later.update(1000 * NS_PER_MS, 0.02)[0].pwm_us == first.update(1000 * NS_PER_MS, 0.02)[0].pwm_us
    assert later.deadman_trips == 1


def test_every_command_on_the_link_has_its_own_sequence_number() -> None:
    pilot = new_pilot()
    numbers = [pilot.update(0, 0.02)[0].sequence for _ in range(70_000)]
    assert numbers[:3] == [1, 2, 3]
    assert numbers[65_534:65_537] == [65_535, 0, 1]


def test_each_sensor_updates_its_part_of_the_navigation() -> None:
    pilot, attitude = new_pilot(), from_euler(0.1, -0.2, 0.3)
    assert pilot.navigation == ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)
    pilot.update_sensor("pressure", PressureSample(0, ATMOSPHERE_PA + pressure_at(5.0, WORLD.density * WORLD.gravity)))
    pilot.update_sensor("imu", ImuSample(0, attitude, (0.1, 0.2, 0.3), (0.0, 0.0, -9.8)))
    pilot.update_sensor(
        "odom", OdometrySample(0, (7.0, 8.0, 9.0), (1.0, 0.0, 0.0, 0.0), (1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    )
    assert pilot.navigation[:3] == (attitude, (0.1, 0.2, 0.3), (1.0, 2.0, 3.0))
    assert pilot.navigation.depth == pytest.approx(5.0)
    assert pilot.position == (7.0, 8.0, 9.0)


def test_a_rotated_imu_gives_the_vehicles_attitude_and_rates() -> None:
    askew, attitude, rates = Mounting(orientation=(0.3, -0.4, 0.5 * pi)), from_euler(0.1, -0.2, 0.4), (0.1, 0.2, 0.3)
    pilot = Pilot(VEHICLE, parse(CONTROL, Gains, "control"), WORLD.density * WORLD.gravity, NS_PER_MS, askew)
    its_attitude, its_rates = multiply(attitude, askew.quaternion), rotate_inverse(askew.quaternion, rates)
    pilot.update_sensor("imu", ImuSample(0, its_attitude, its_rates, (0.0, 0.0, -9.8)))
    assert pilot.navigation.orientation == pytest.approx(attitude)
    assert pilot.navigation.angular_velocity == pytest.approx(rates)


@pytest.mark.parametrize(
    ("command", "axis"),
    [
        (VelocityCommand(surge=0.6), 0),
        (VelocityCommand(surge=-0.4), 0),
        (VelocityCommand(sway=0.4), 1),
        (VelocityCommand(heave=0.2), 2),
        (VelocityCommand(yaw_rate=0.4), 5),
    ],
)
def test_the_vehicle_follows_the_commands(command: VelocityCommand, axis: int) -> None:
    pilot = new_pilot(10_000)
    simulation = Simulation(VEHICLE, WORLD, seed=3, position=(0.0, 0.0, 2.0))
    pulses: tuple[int, ...] = NEUTRAL
    for step in range(400 * 5):
        for topic, sample in simulation.step(pulses):
            pilot.update_sensor(topic, sample)
        if step % 8 == 0:
            pilot.set_command(command, simulation.time_ns)
            pulses = pilot.update(simulation.time_ns, 0.02)[0].pwm_us
    target = (command.surge, command.sway, command.heave, 0.0, 0.0, command.yaw_rate)
    nu = simulation.truth().nu
    assert nu[axis] == pytest.approx(target[axis], abs=0.05)
    others = [abs(nu[i]) for i in (0, 1, 2, 5) if i != axis]
    assert max(others) < 0.06


def test_azimuth_thrusters_turn_to_where_the_force_is_wanted() -> None:
    otter, control = load_vehicle("otter")
    places = zip(otter.thrusters, (0.7, -0.8), strict=True)
    thrusters = tuple([one._replace(position=(x, 0.0, 0.25), azimuth=Azimuth(pi)) for one, x in places])
    pilot = build_pilot(load_scenario("paper_field"), otter._replace(thrusters=thrusters), control, WORLD)
    pilot.set_command(WrenchSetpoint((10.0, 30.0, 0.0, 0.0, 0.0, 6.0)), 0)
    *pushes, bow, stern = pilot.update(0, 0.02)[0].pwm_us
    thrusts = [SteadyThrusts(one)[pulse] for one, pulse in zip(thrusters, pushes, strict=True)]
    angles = [(pulse - 1500) / 400 * pi for pulse in (bow, stern)]
    ahead, aside = ([thrust * f(angle) for thrust, angle in zip(thrusts, angles, strict=True)] for f in (cos, sin))
    assert (sum(ahead), sum(aside), 0.7 * aside[0] - 0.8 * aside[1]) == pytest.approx((10.0, 30.0, 6.0), abs=0.5)


def test_a_plant_weighs_and_floats_as_its_vehicle_and_fins_have_their_own_controller() -> None:
    plant, mass = plant_of(VEHICLE, WORLD.density, WORLD.gravity), mass_matrix(VEHICLE)
    lift = Simulation(VEHICLE, WORLD, {}, position=(0.0, 0.0, 2.0)).forces().restoring[2]
    assert (plant.weight, plant.weight - plant.buoyancy) == pytest.approx((VEHICLE.mass * WORLD.gravity, lift))
    assert plant.inertia == tuple([mass[axis][axis] for axis in range(6)])
    lauv, control = load_vehicle("lauv")
    assert type(build_pilot(load_scenario("paper_field"), lauv, control, WORLD).controller).__name__ == "FinController"
    with pytest.raises(ConfigError, match="a vehicle with fins is steered by the cascade"):
        build_pilot(load_scenario("paper_field"), lauv, {**control, "family": "other"}, WORLD)


@pytest.mark.parametrize("name", ["paper_six", "paper_seven", "bluerov2"])
def test_a_vehicle_stopped_by_a_wall_pushes_no_harder_than_a_current(name: str) -> None:
    """The vehicle is commanded to stop there: its speed is then as commanded, and no error lessens the integral."""
    vehicle, control = load_vehicle(name)
    gains = parse(control, Gains, "control")
    controller = Pilot(vehicle, gains, WORLD.density * WORLD.gravity, NS_PER_MS).controller
    at_wall = Navigation((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 5.0)
    for command in [VelocityCommand(surge=0.3)] * 2000 + [VelocityCommand()]:
        wrench = controller.update(command, at_wall, 0.02)
    speed = gains.surge.current
    assert _drags(load_vehicle("lauv")[0]) == [], "its fins add to it"
    assert wrench[0] == pytest.approx(vehicle.linear_damping[0] * speed + vehicle.quadratic_damping[0] * speed**2)
