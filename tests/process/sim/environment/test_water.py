"""Currents, waves and layers of the water, and the forces that they have on a vehicle."""

from math import pi

import pytest

from sim.dynamics import State
from sim.environment.ocean import Layers, Ocean, Profile, Waves
from sim.environment.seawater.pressure import ATMOSPHERE_PA
from sim.environment.seawater.water_column import WaterColumn
from sim.environment.water import FluidMotion, SampledWaves, wave_inertia
from sim.environment.waves import WaveField
from sim.environment.world import World
from sim.rotations import from_euler, rotate
from sim.sensors.error import ErrorModel
from sim.sensors.pressure import PressureModel
from sim.sensors.samples import PressureSample
from sim.sensors.sensor_set import select_sensors
from sim.simulation import Simulation
from sim.vehicle.vehicle import Vehicle, load_vehicle

G = 9.80665
VEHICLE = load_vehicle("bluerov2_heavy")[0]._replace(neutrally_buoyant=True)
SEA = World("sea", "test", (-100.0, 100.0, -100.0, 100.0), 60.0, gravity=G)
QUIET = select_sensors(
    imu=None,
    dvl=None,
    pressure=PressureModel(error=ErrorModel()),
    odometry=None,
)
# A swell of one wave: 1 m high from trough to crest is Hs = 4 sqrt(a²/2) with a = 0.5 m.
SWELL = Waves(significant_height=2.0 * 2.0**0.5 * 0.5, peak_period=9.0, components=1, direction=0.4, hold=0.0)


def at_sea(ocean: Ocean, vehicle: Vehicle = VEHICLE, seed: int = 1, depth: float = 6.0) -> Simulation:
    return Simulation(vehicle, SEA._replace(ocean=ocean), QUIET, seed, position=(0.0, 0.0, depth), heading=0.7)


def run(simulation: Simulation, seconds: float) -> None:
    idle = (1500,) * len(simulation.vehicle.thrusters)
    for _ in range(round(seconds * 400)):
        simulation.step(idle)


def over_ground(simulation: Simulation) -> tuple[float, float, float]:
    return rotate(simulation.state.quaternion, simulation.state.nu[:3])


# -- currents in the simulation -----------------------------------------------------------------------------------


def test_a_current_of_the_world_moves_the_vehicle() -> None:
    """An idle vehicle drifts with the velocity of its own layer, and does not turn."""
    simulation = at_sea(Ocean(layers=Layers((0.0, 12.0), north=(0.6, 0.2), east=(0.0, -0.2))))
    run(simulation, 120.0)
    assert over_ground(simulation) == pytest.approx((0.4, -0.1, 0.0), abs=0.01)
    assert simulation.truth().position[0] > 30.0


# -- waves in the simulation --------------------------------------------------------------------------------------


def test_a_vehicle_without_net_weight_or_drag_follows_the_water() -> None:
    """The vehicle moves as the water would, whatever its added mass, in waves that change little along the hull.

    It starts with the velocity of the water. For three waves it is at the place of a water particle, whose path is
    integrated separately, and tilts no more than the water's slope.
    """
    body = VEHICLE._replace(linear_damping=(0.0, 0.0, 0.0, 9.0, 9.0, 9.0), quadratic_damping=(0.0,) * 6)
    body = body._replace(center_of_gravity=(0.0, 0.0, 0.0), center_of_buoyancy=(0.0, 0.0, 0.0))
    simulation = at_sea(Ocean(waves=SWELL), body)
    wave_field = WaveField(SWELL, SEA.depth, G, 1)
    point = [0.0, 0.0, 6.0]
    simulation.state.nu = [*rotate(from_euler(0.0, 0.0, -0.7), wave_field.motion(0.0, *point).velocity), 0.0, 0.0, 0.0]
    largest = 0.0
    for step in range(400 * 27):
        middle = [x + 0.00125 * v for x, v in zip(point, wave_field.motion(step / 400.0, *point).velocity, strict=True)]
        velocity = wave_field.motion((step + 0.5) / 400.0, *middle).velocity
        point = [x + 0.0025 * v for x, v in zip(point, velocity, strict=True)]
        simulation.step((1500,) * 8)
        gap = max(abs(a - b) for a, b in zip(simulation.truth().position, point, strict=True))
        largest = max(largest, gap)
    assert largest < 0.02  # of a motion of a metre; without the v . grad v of the water 2 m
    assert simulation.truth().orientation == pytest.approx(from_euler(0.0, 0.0, 0.7), abs=0.02)


def test_waves_move_a_deeper_vehicle_less() -> None:
    def stroke(depth: float) -> float:
        simulation, heights = at_sea(Ocean(waves=SWELL), depth=depth), []
        for _ in range(20):
            run(simulation, 0.5)
            heights.append(simulation.truth().position[2] - depth)
        return max(heights) - min(heights)

    near, far = stroke(5.0), stroke(40.0)
    assert 0.3 < near < 1.0  # less than the water's own metre at the surface
    assert far < 0.15 * near


def test_the_force_of_the_waves_matches_its_formula() -> None:
    """The force is (M_A + rho V) a in body axes, by hand for a vehicle on its side."""
    body = VEHICLE._replace(added_mass=(5.0, 12.0, 20.0, 0.1, 0.1, 0.1), volume=0.012, neutrally_buoyant=False)
    body = body._replace(center_of_buoyancy=(0.0, 0.0, -0.02))
    world = SEA._replace(ocean=Ocean(waves=SWELL))
    state = State((3.0, 4.0, 2.0), from_euler(pi / 2.0, 0.0, 0.0))  # starboard (y) is down, z is west
    velocity, wrench = FluidMotion(body, world, 1).act(7_000_000_000, state, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    motion = WaveField(SWELL, SEA.depth, G, 1).motion(7.0, 3.0, 4.0, 2.0)
    north, east, down = motion.acceleration
    displaced = 1025.0 * 0.012
    force = (5.0 + displaced) * north, (12.0 + displaced) * down, (20.0 + displaced) * -east
    moment = 0.02 * displaced * down, -0.02 * displaced * north, 0.0
    assert wrench == pytest.approx((1.0 + force[0], *force[1:], *moment), rel=1e-4)  # a hull is no point
    assert velocity == pytest.approx(motion.velocity, rel=1e-4)
    assert abs(north) > 0.01
    assert abs(down) > 0.01


def test_accelerated_mass_of_a_trimmed_vehicle() -> None:
    """A weightless vehicle displaces its own mass, and the moment is about the origin."""
    body = VEHICLE._replace(
        added_mass=(0.0,) * 6, neutrally_buoyant=True, mass=11.0, center_of_buoyancy=(0.1, 0.0, 0.0)
    )
    rows = wave_inertia(body, 1000.0)
    assert rows[0] == pytest.approx([11.0, 0.0, 0.0])
    assert rows[4] == pytest.approx([0.0, 0.0, -1.1])  # pushed down ahead of the origin: bow down
    assert rows[5] == pytest.approx([0.0, 1.1, 0.0])


def test_sampled_waves_are_exact_at_their_rate_and_close_between() -> None:
    """The error between two samples is the stated fraction of the wave."""
    waves = SWELL._replace(hold=0.05)
    sampled, sea = SampledWaves(waves, SEA, 1), WaveField(waves, SEA.depth, G, 1)
    (wave,) = sea.components
    most = 0.5 * (wave.omega * waves.hold) ** 2
    speed = wave.amplitude * wave.omega
    for step in range(401):
        time, exact = step * 0.0025, sea.motion(step * 0.0025, 0.0, 0.0, 3.0)
        motion = sampled.motion(step * 2_500_000, (0.0, 0.0, 3.0))
        if step % 20 == 0:
            assert motion == exact
        steep = wave.wave_number * wave.amplitude * wave.omega * waves.hold  # of (v . grad) v
        assert motion.velocity == pytest.approx(exact.velocity, abs=(most + steep) * speed)
        assert sampled.wave_field.surface(time, 0.0, 0.0) == pytest.approx(exact.surface[0], abs=most * wave.amplitude)
        assert exact.surface[0] == pytest.approx(sea.elevation(time, 0.0, 0.0), abs=1e-15)


def test_a_moved_vehicle_gets_the_waves_of_its_new_position_at_once() -> None:
    waves = SWELL._replace(hold=0.1, peak_period=5.0)
    sampled, sea = SampledWaves(waves, SEA, 1), WaveField(waves, SEA.depth, G, 1)
    sampled.motion(0, (0.0, 0.0, 3.0))
    assert sampled.motion(2_500_000, (20.0, 5.0, 1.0)) == sea.motion(0.0025, 20.0, 5.0, 1.0)
    assert sampled.wave_field.surface(0.0025, 20.0, 5.0) == pytest.approx(sea.elevation(0.0025, 20.0, 5.0))
    far = sea.elevation(0.0025, -30.0, 5.0)
    assert sampled.wave_field.surface(0.0025, -30.0, 5.0) == far, "away from what is held it is the sea itself"


def test_the_sampled_surface_follows_rate_and_slopes() -> None:
    waves = SWELL._replace(components=50, hold=0.025, peak_period=6.0, spread=0.3)
    sampled, sea = SampledWaves(waves, SEA, 1), WaveField(waves, SEA.depth, G, 1)
    for number in range(200):
        time_ns = number * 1_000_000_000
        sampled.motion(time_ns, (0.0, 0.0, 3.0))
        exact = sea.elevation(time_ns * 1e-9 + 0.02, 0.03, -0.02)
        assert sampled.wave_field.surface(time_ns * 1e-9 + 0.02, 0.03, -0.02) == pytest.approx(exact, abs=0.002)


# -- density and sound speed --------------------------------------------------------------------------------------

PROFILE = Profile((0.0, 20.0, 100.0), (1022.0, 1026.0, 1027.5), (1510.0, 1495.0, 1490.0))


def test_density_and_sound_speed_are_interpolated() -> None:
    column = WaterColumn(PROFILE, G)
    assert column.density(10.0) == pytest.approx(1024.0)
    assert column.density(500.0) == 1027.5
    assert column.sound_speed(60.0) == pytest.approx(1492.5)
    assert WaterColumn(Profile((5.0,), (1000.0,)), G).sound_speed(3.0) == 1500.0


@pytest.mark.parametrize("first", [0.0, 3.0])
def test_pressure_is_the_weight_of_the_water_above(first: float) -> None:
    """Thin layers by hand agree: density in place, and gravity that grows by 2.2e-7 of it a metre."""
    profile = Profile((first, 20.0, 100.0), PROFILE.density)
    column = WaterColumn(profile, G)
    for depth in (0.5, 3.0, 10.0, 20.0, 55.5, 100.0, 250.0):
        layers = [depth * (i + 0.5) / 2000 for i in range(2000)]
        weight = sum(column.density(z) * G * (1.0 + 2.226e-7 * z) for z in layers) * depth / 2000
        assert column.pressure(depth) == pytest.approx(weight, rel=1e-6)
    assert column.pressure(0.0) == column.pressure(-2.0) == 0.0


def test_the_pressure_sensor_uses_the_density_profile() -> None:
    simulation = at_sea(Ocean(profile=PROFILE), depth=10.0)
    samples = [sample for _ in range(400) for topic, sample in simulation.step((1500,) * 8) if topic == "pressure"]
    depth = simulation.truth().position[2]
    last = samples[-1]
    assert isinstance(last, PressureSample)
    assert last.pascal == pytest.approx(ATMOSPHERE_PA + WaterColumn(PROFILE, G).pressure(depth), rel=1e-12)
    assert abs(last.pascal - ATMOSPHERE_PA - 1025.0 * G * depth) > 100.0
