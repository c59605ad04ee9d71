"""A floating hull in waves against linear theory: the forces on a fixed box, and a free one in long waves."""

from cmath import exp as cexp
from math import cos, exp, pi, sin, sqrt

import pytest

from sim import rotations
from sim.environment.ocean import Ocean, Waves
from sim.environment.stratification import WavySurface
from sim.environment.water import FluidMotion
from sim.environment.waves import Component, WaveField
from sim.environment.world import World
from sim.rotations import to_euler
from sim.sensors.sensor_set import select_sensors
from sim.simulation import Simulation
from sim.vehicle.buoyancy import Hull
from sim.vehicle.vehicle import Vehicle, load_vehicle

RHO, G = 1000.0, 9.81
LENGTH, WIDTH, HEIGHT = 2.0, 1.0, 0.3
DRAUGHT = 0.15
NONE = select_sensors(imu=None, dvl=None, pressure=None, odometry=None)


def box(**changes: object) -> Vehicle:
    """Return a box that floats half out of the water, without damping unless told."""
    volume = LENGTH * WIDTH * HEIGHT
    mass = RHO * 0.5 * volume
    calm = load_vehicle("paper_six")[0]._replace(
        mass=mass, volume=volume, dimensions=(LENGTH, WIDTH, HEIGHT), neutrally_buoyant=False,
        center_of_buoyancy=(0.0, 0.0, 0.0), center_of_gravity=(0.0, 0.0, 0.02),
        inertia=(mass * 0.1, mass * (LENGTH**2 + HEIGHT**2) / 12.0, mass * 0.4), added_mass=(0.0,) * 6,
        linear_damping=(0.0,) * 6, quadratic_damping=(0.0,) * 6,
    )  # fmt: skip
    return calm._replace(**changes)  # type: ignore[arg-type]


def sea(period: float, amplitude: float, hold: float = 0.0, direction: float = 0.0) -> World:
    height = 2.0 * sqrt(2.0) * amplitude
    waves = Waves(height, period, components=1, direction=direction, hold=hold)
    return World("sea", "test", (-500.0, 500.0, -500.0, 500.0), 200.0, density=RHO, gravity=G, ocean=Ocean(waves=waves))


def amplitude_at(omega: float, values: list[float], times: list[float]) -> complex:
    """Return the complex amplitude of the component of `values` at `omega`."""
    mean = sum(values) / len(values)
    return 2.0 / len(values) * sum((v - mean) * cexp(1j * omega * t) for v, t in zip(values, times, strict=True))


def wave_of(world: World) -> Component:
    assert world.ocean is not None
    assert world.ocean.waves is not None
    return WaveField(world.ocean.waves, world.depth, G, 1).components[0]


def forces_on_fixed_box(world: World, heading: float) -> tuple[complex, complex, complex]:
    """Return the amplitudes of surge, heave and pitch moment on a box that does not move."""
    vehicle, wave = box(), wave_of(world)
    water = FluidMotion(vehicle, world, 1)
    assert water.wave_field is not None
    surface = WavySurface(vehicle, Hull(vehicle, RHO, G), water.wave_field, G)
    simulation = Simulation(vehicle, world._replace(ocean=None), NONE, 1, position=(0.0, 0.0, 0.0), heading=heading)
    state, rows, times = simulation.state, [], [i * 2.0 * pi / wave.omega / 60.0 for i in range(60)]
    rotation = rotations.matrix(state.quaternion)
    for time in times:
        _, pushed = water.act(round(time * 1e9), state, (0.0,) * 6)
        surface.begin(round(time * 1e9))
        rows.append([a + b for a, b in zip(pushed, surface.wrench(state.position, rotation, (0.0,) * 6), strict=True)])
    return tuple(amplitude_at(wave.omega, [row[i] for row in rows], times) for i in (0, 2, 4))  # type: ignore[return-value]


@pytest.mark.parametrize("period", [1.5, 2.0, 3.0, 6.0])
def test_the_forces_on_a_fixed_box_are_those_of_the_undisturbed_wave(period: float) -> None:
    """Froude and Krylov in closed form, pressure rho g a exp(-k z) on the sides and the bottom; waves from ahead.

    The shortest wave is 1.8 hulls long.
    """
    world = sea(period, 0.005)
    k, a = wave_of(world).wave_number, wave_of(world).amplitude
    surge, heave, pitch = forces_on_fixed_box(world, 0.0)
    x = 0.5 * k * LENGTH
    on_ends = 2.0 * RHO * G * a * WIDTH * (1.0 - exp(-k * DRAUGHT)) / k * sin(x)
    on_bottom = RHO * G * a * exp(-k * DRAUGHT) * WIDTH * 2.0 / k * sin(x)
    moment_bottom = RHO * G * a * exp(-k * DRAUGHT) * WIDTH * 2.0 / k**2 * (sin(x) - x * cos(x))
    assert abs(surge) == pytest.approx(on_ends, rel=0.03)
    assert abs(heave) == pytest.approx(on_bottom, rel=0.03)
    moment_ends = 2.0 * RHO * G * a * WIDTH * sin(x) * (1.0 - exp(-k * DRAUGHT) * (1.0 + k * DRAUGHT)) / k**2
    assert abs(pitch) == pytest.approx(moment_bottom - moment_ends, rel=0.06)


@pytest.mark.parametrize("period", [6.0, 10.0])
@pytest.mark.parametrize("beam", [False, True])
def test_a_floating_hull_follows_a_long_wave(period: float, beam: bool) -> None:
    """It heaves with the surface, tilts with its slope, and surges with the water at half its draught."""
    world = sea(period, 0.1, hold=0.025, direction=0.5 * pi if beam else 0.0)
    vehicle = box(
        added_mass=(20.0, 60.0, 300.0, 20.0, 60.0, 10.0), linear_damping=(0.0, 0.0, 900.0, 120.0, 400.0, 50.0)
    )
    simulation = Simulation(vehicle, world, NONE, 1, position=(0.0, 0.0, 0.0), heading=0.0)
    wave = wave_of(world)
    idle, times, rows = (1500,) * len(vehicle.thrusters), [], []
    steps = round(4.0 * period * 400)
    field = WaveField(world.ocean.waves, world.depth, G, 1)  # type: ignore[union-attr,arg-type]
    for step in range(2 * steps):
        simulation.step(idle)
        if step >= steps and step % 10 == 0:
            state, time = simulation.state, simulation.time_ns * 1e-9
            roll, pitch, _ = to_euler(state.quaternion)
            motion = field.motion(time, state.position[0], state.position[1], 0.5 * DRAUGHT)
            velocity = rotations.rotate(state.quaternion, state.nu[:3])
            along = 1 if beam else 0
            times.append(time)
            rows.append([
                -state.position[2], motion.surface[0], -roll if beam else pitch, motion.surface[2 + along],
                velocity[along], motion.velocity[along],
            ])  # fmt: skip
    amplitudes = [amplitude_at(wave.omega, [row[i] for row in rows], times) for i in range(6)]
    heave, tilt, surge = amplitudes[0] / amplitudes[1], amplitudes[2] / amplitudes[3], amplitudes[4] / amplitudes[5]
    tolerance = 0.12 if period < 8.0 else 0.05
    assert heave == pytest.approx(1.0, abs=tolerance)
    assert tilt == pytest.approx(1.0, abs=tolerance)
    assert surge == pytest.approx(1.0, abs=tolerance)


@pytest.mark.parametrize("period", [2.2, 2.6, 3.0, 4.0, 6.0])
def test_a_box_responds_as_published_of_potential_theory(period: float) -> None:
    """Heave and pitch in waves from ahead: Jensen, Mansour and Olsen, Ocean Engineering 31 (2004), eqs (1) to (10).

    Closed forms of strip theory for a box: the sectional added mass is the displaced mass, the damping that of the
    waves that the box radiates, which depends on the frequency.
    """
    world = sea(period, 0.004, hold=0.01)
    k, omega = wave_of(world).wave_number, wave_of(world).omega
    radiated = (2.0 * sin(0.5 * k * WIDTH) * exp(-k * DRAUGHT)) ** 2 / (k * WIDTH)
    x, kt = 0.5 * k * LENGTH, k * DRAUGHT
    response = exp(-kt) * abs(complex(1.0 - kt, radiated)) / abs(complex(1.0 - 2.0 * kt, radiated))
    published = (response * sin(x) / x, response * 6.0 / (x**2 * LENGTH) * (sin(x) - x * cos(x)))

    stiffness = [RHO * G * LENGTH * WIDTH, RHO * G * WIDTH * LENGTH**3 / 12.0]
    lifting, turning = [each * radiated / omega for each in stiffness]
    mass = RHO * LENGTH * WIDTH * DRAUGHT
    vehicle = box(
        added_mass=(0.0, 0.0, mass, 0.0, mass * LENGTH**2 / 12.0, 0.0),
        linear_damping=(9.0, 9.0, lifting, 90.0, turning, 50.0),
    )
    simulation = Simulation(vehicle, world, NONE, 1, position=(0.0, 0.0, 0.0), heading=0.0)
    idle, times, rows = (1500,) * len(vehicle.thrusters), [], []
    steps = round(10.0 * period * 400)
    for step in range(2 * steps):
        simulation.step(idle)
        if step >= steps and step % 8 == 0:
            time, state = simulation.time_ns * 1e-9, simulation.state
            times.append(time)
            surface = simulation.wave_field.elevation(time, 0.0, 0.0)  # type: ignore[union-attr]
            rows.append((-state.position[2], to_euler(state.quaternion)[1], surface))
    heave, pitch, elevation = [amplitude_at(omega, [row[i] for row in rows], times) for i in range(3)]
    assert abs(heave / elevation) == pytest.approx(published[0], rel=0.06)
    assert abs(pitch / elevation) == pytest.approx(published[1], rel=0.06)
