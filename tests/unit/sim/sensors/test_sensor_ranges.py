"""Laser, profiler, echosounder, scanning sonar; and DVL and altimeter over relief and obstacles."""

from math import atan, cos, inf, isnan, log10, pi, radians, sin, sqrt, tan
from random import Random
from statistics import fmean, pstdev

import numpy as np
import pytest

from sim.dynamics import State
from sim.environment.obstacles import Box, Cylinder
from sim.environment.relief import Slope
from sim.environment.terrain import Terrain, covering
from sim.environment.world import World
from sim.rotations import from_euler, rotate
from sim.sensors.error import ErrorModel
from sim.sensors.imaging.scanning_sonar import ScanningSonar, ScanningSonarModel
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.altimeter import Altimeter, AltimeterModel
from sim.sensors.ranging.beams import RangeErrors
from sim.sensors.ranging.dvl import Dvl, DvlModel
from sim.sensors.ranging.echosounder import Echosounder, EchosounderModel
from sim.sensors.ranging.laser import Laser, LaserModel
from sim.sensors.ranging.profiler import Profiler, ProfilerModel
from sim.sensors.sensor_set import read_sensors
from sim.simulation import Simulation
from tests.support.fitted import EXACT, EXTENT, FLAT, NU, VEHICLE, scene

POOL = World("pool", "test", (-8.0, 10.0, -7.0, 9.0), 20.0, walls=True)
SLOPE = Slope(20.0, 0.25)  # 20 m + north / 4: exact in 32-bit floats
ASKEW = Mounting((0.3, -0.1, 0.2), (0.1, -0.2, 2.5))


def sloping_world() -> World:
    grid = covering(EXTENT, 1.0)
    return FLAT._replace(terrain=Terrain(grid, SLOPE.depths(grid), 20.0))


def distance_to_slope(position: tuple[float, ...], direction: tuple[float, ...]) -> float:
    """Return the distance from a place to the plane depth = 20 + north / 4, by hand."""
    return (20.0 + 0.25 * position[0] - position[2]) / (direction[2] - 0.25 * direction[0])


# --- laser


@pytest.mark.parametrize("heading", [0.0, 0.8, -2.5])
def test_a_laser_measures_the_walls_of_a_pool(heading: float) -> None:
    """Every beam's range follows from heading and angle, which grows from the bow to starboard."""
    laser = Laser(LaserModel(ground_truth=True), Mounting(), 1, scene(POOL))
    sample = laser.sample(7, State((1.0, 2.0, 5.0), from_euler(0.0, 0.0, heading)))
    assert sample.angle_min == pytest.approx(-pi)
    assert sample.angle_increment == pytest.approx(radians(1.0))
    assert sample.limits == (0.1, 30.0)
    for i, distance in enumerate(sample.ranges):
        course = heading + sample.angle_min + i * sample.angle_increment
        to_north = 9.0 / abs(cos(course) or 1e-9)
        to_east = (7.0 if sin(course) > 0.0 else 9.0) / abs(sin(course) or 1e-9)
        assert distance == pytest.approx(min(to_north, to_east), abs=1e-6)


def test_a_laser_has_range_limits_and_none_in_air() -> None:
    world = FLAT._replace(cylinder=(Cylinder(2.0, 0.0, 1.95), Cylinder(-45.0, 0.0, 1.0)))
    laser = Laser(LaserModel(), Mounting(), 1, Simulation(VEHICLE, world, {}, position=(30.0, 30.0, 5.0)))
    under_water = laser.sample(0, State((0.0, 0.0, 5.0))).ranges
    assert under_water[180] == -inf  # 5 cm ahead
    assert under_water[0] == inf  # 44 m astern
    assert laser.sample(1, State((0.0, 0.0, -0.1))).ranges == (inf,) * 360


def test_beams_of_a_laser_share_its_constant_errors() -> None:
    state, model = State((1.0, 1.0, 5.0)), LaserModel(beams=40)
    true = Laser(model._replace(ground_truth=True), Mounting(), 1, scene(POOL)).sample(0, state).ranges
    off = Laser(model._replace(error=ErrorModel(turn_on=0.5, scale=0.1)), Mounting(), 3, scene(POOL)).sample(0, state)
    first, second, *_ = off.ranges
    gain = (first - second) / (true[0] - true[1])
    constant = first - gain * true[0]
    assert all(a == pytest.approx(gain * b + constant, abs=1e-9) for a, b in zip(off.ranges, true, strict=True))
    assert gain != pytest.approx(1.0, abs=1e-3)
    assert constant != pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(
    ("model", "mean", "deviation"),
    [(ErrorModel(offset=0.5), 5.5, 0.0), (ErrorModel(offset=0.5, noise=0.2), 5.5, 0.2),
     (ErrorModel(offset=0.3, resolution=0.25), 5.25, 0.0), (ErrorModel(offset=7.0, limit=9.0), 9.0, 0.0),
     (ErrorModel(noise_density=0.01, noise=0.1), 5.0, sqrt(0.02)), (ErrorModel(noise_share=0.1), 5.0, 0.5),
     (ErrorModel(offset=0.2, outliers=0.1, outlier=3.0), 5.2, sqrt(0.9))],
)  # fmt: skip
def test_each_of_many_distances_has_errors_of_its_stated_size(model: ErrorModel, mean: float, deviation: float) -> None:
    errors = RangeErrors(model, 0.01, Random(1), (0.0, inf)).measure([5.0] * 20_000)
    assert (fmean(errors), pstdev(errors)) == pytest.approx((mean, deviation), rel=0.02)


# --- profiler


@pytest.mark.parametrize("mounting", [Mounting(), ASKEW])
def test_a_profiler_measures_a_slope(mounting: Mounting) -> None:
    model = ProfilerModel(beams=61, ground_truth=True)
    state = State((1.0, 2.0, 5.0), from_euler(0.1, -0.15, 0.9), NU)
    sample = Profiler(model, mounting, 1, scene(sloping_world())).sample(3, state)
    attitude, position = mounting.attitude(state), mounting.world_position(state)
    assert sample.angle_min == pytest.approx(radians(-60))
    for i, distance in enumerate(sample.ranges):
        angle = sample.angle_min + i * sample.angle_increment
        expected = distance_to_slope(position, rotate(attitude, (0.0, sin(angle), cos(angle))))
        assert distance == pytest.approx(expected, abs=1e-6)


def test_a_profiler_detects_a_block_to_starboard() -> None:
    world = FLAT._replace(box=(Box(0.0, 8.0, 4.0, 4.0, top=15.0),))
    sample = Profiler(ProfilerModel(ground_truth=True), Mounting(), 1, scene(world)).sample(0, State((0.0, 0.0, 5.0)))
    heights = [x * cos(sample.angle_min + i * sample.angle_increment) for i, x in enumerate(sample.ranges)]
    on_top = [i for i, height in enumerate(heights) if height == pytest.approx(10.0)]
    assert on_top
    assert all(sample.angle_min + i * sample.angle_increment > atan(0.6) - 1e-9 for i in on_top)


def test_strengths_of_a_profile_follow_lamberts_law() -> None:
    """Strengths are 20 lg cos of the angle below straight down; a block is 7 dB stronger; else there are none."""
    model = ProfilerModel(beams=61, ground_truth=True, max_range=25.0)
    world = FLAT._replace(box=(Box(0.0, 4.0, 4.0, 4.0, top=18.0),))
    sample = Profiler(model, Mounting(), 1, scene(world)).sample(0, State((0.0, 0.0, 5.0)))
    for i, (distance, strength) in enumerate(zip(sample.ranges, sample.intensities, strict=True)):
        angle = sample.angle_min + i * sample.angle_increment
        if distance == inf:
            assert isnan(strength)
        elif angle < 0.1:
            assert strength == pytest.approx(-27.0 + 20.0 * log10(cos(angle)), abs=1e-6)
    top = min(range(61), key=lambda i: abs(sample.angle_min + i * sample.angle_increment - atan(4.0 / 13.0)))
    angle = sample.angle_min + top * sample.angle_increment
    assert sample.intensities[top] == pytest.approx(-20.0 + 20.0 * log10(cos(angle)), abs=1e-6)
    assert any(map(isnan, sample.intensities))
    dry = Profiler(model, Mounting(), 1, scene(world)).sample(0, State((0.0, 0.0, -0.1)))
    assert (dry.ranges, all(map(isnan, dry.intensities))) == ((inf,) * 61, True)


def test_a_wide_profiler_beam_rounds_an_edge() -> None:
    """A cliff that faces away from the sonar is a step for rays; a wide beam has distances between its two sides."""
    world = FLAT._replace(box=(Box(0.0, -9.0, 40.0, 22.0, top=14.0),))  # up to 2 m to starboard, 6 m high

    def depths(width: float) -> list[float]:
        model = ProfilerModel(beams=241, beam_width=radians(width), rings=3, ground_truth=True)
        sample = Profiler(model, Mounting(), 1, scene(world)).sample(0, State((0.0, 0.0, 5.0)))
        return [r * cos(sample.angle_min + i * sample.angle_increment) for i, r in enumerate(sample.ranges)]

    between = [sum(9.5 < depth < 14.5 for depth in depths(width)) for width in (0.0, 6.0)]
    assert between[0] == 0
    assert between[1] > 3


def test_fading_of_a_profile_preserves_its_mean() -> None:
    one, same, other = (Profiler(ProfilerModel(looks=4.0), Mounting(), seed, scene(FLAT)) for seed in (1, 1, 2))
    state = State((0.0, 0.0, 5.0))
    first, again, third = (device.sample(0, state) for device in (one, same, other))
    assert first == again
    assert first.intensities != third.intensities
    middle = [10.0 ** (0.1 * one.sample(i, state).intensities[60]) for i in range(1, 400)]
    assert fmean(middle) == pytest.approx(10.0**-2.7, rel=0.1)
    assert pstdev(middle) / fmean(middle) == pytest.approx(0.5, rel=0.15)


# --- echosounder


@pytest.mark.parametrize("width", [0.0, 5.0, 25.0, 60.0])
def test_an_echosounder_measures_the_nearest_echo_in_its_cone(width: float) -> None:
    """The range over a slope of 14 deg is the perpendicular if the cone is wide enough, else the edge of the cone."""
    model = EchosounderModel(beam_width=radians(width), rings=12, ground_truth=True)
    echosounder = Echosounder(model, Mounting(), 1, scene(sloping_world()))
    distance = echosounder.sample(0, State((0.0, 0.0, 5.0))).distance
    slope, half = atan(0.25), radians(0.5 * width)
    aside = min(half, slope)
    expected = 15.0 / (cos(aside) + 0.25 * sin(aside))
    assert distance == pytest.approx(expected, rel=0.001)
    assert distance >= expected - 1e-9


def test_an_echosounder_has_its_errors_and_limits() -> None:
    echosounder, state = Echosounder(EchosounderModel(), Mounting(), 1, scene()), State((0.0, 0.0, 10.0))
    assert pstdev(echosounder.sample(i, state).distance for i in range(1000)) == pytest.approx(0.005, rel=0.1)
    assert echosounder.sample(0, State((0.0, 0.0, 19.9))).distance == -inf
    assert echosounder.sample(0, State((0.0, 0.0, -1.0))).distance == inf
    assert echosounder.sample(0, State((0.0, 0.0, 5.0), from_euler(pi, 0.0, 0.0))).distance == inf


# --- scanning sonar

SONAR = ScanningSonarModel(ground_truth=True, beam_width=0.0, beam_height=0.0, rings=0)


def test_a_scanning_sonar_scans_a_full_turn() -> None:
    """A turn is 400 pings of 1 grad; each range is that of the wall in its direction."""
    sonar, state = ScanningSonar(SONAR, Mounting(), 1, scene(POOL)), State((0.0, 0.0, 5.0))
    samples = [sonar.sample(i, state) for i in range(401)]
    assert samples[400].angle_min == samples[0].angle_min == pytest.approx(-pi)
    assert samples[200].angle_min == pytest.approx(0.0, abs=1e-12)
    for sample in samples:
        north, east = cos(sample.angle_min), sin(sample.angle_min)
        walls = [(10.0 if north > 0.0 else -8.0) / (north or 1e-9), (9.0 if east > 0.0 else -7.0) / (east or 1e-9)]
        assert list(sample.ranges) == pytest.approx([min(walls)], abs=1e-6)


def test_a_scanning_sonar_sweeps_a_sector() -> None:
    model = SONAR._replace(angle_min=-2.0, angle_max=2.0, step=1.0)
    sonar = ScanningSonar(model, Mounting(), 1, scene(POOL))
    angles = [sonar.sample(i, State((0.0, 0.0, 5.0))).angle_min for i in range(10)]
    assert angles == pytest.approx([-2.0, -1.0, 0.0, 1.0, 2.0, 1.0, 0.0, -1.0, -2.0, -1.0])
    assert model._replace(angle_max=-1.1).validate()
    assert model._replace(angle_max=4.3).validate()
    assert model.validate() is None


def test_scanning_sonar_intensities_show_a_pile_at_its_range() -> None:
    """A pile to starboard is in the ping of that direction, at its range; distances are as without intensities."""
    world = FLAT._replace(cylinder=(Cylinder(0.0, 12.0, 0.5),), depth=500.0)
    model = ScanningSonarModel(bins=1000, max_range=30.0, min_range=0.5, ground_truth=True, surface_strength=-200.0)
    sonar, reference = (ScanningSonar(m, Mounting(), 1, scene(world)) for m in (model, model._replace(bins=0)))
    state, sums = State((0.0, 0.0, 10.0)), {}
    for ping in range(400):
        time_ns, scan, echoes = sonar.sample(ping, state)
        assert scan == reference.sample(ping, state)
        assert (time_ns, echoes.beams, echoes.bins) == (ping, (scan.angle_min,), 1000)
        values = np.frombuffer(echoes.intensities, np.float32)
        sums[scan.angle_min] = values.sum()
        if abs(scan.angle_min - 0.5 * pi) < 1e-6:
            assert int(values.argmax()) == pytest.approx((11.5 - 0.5) / 0.0295, abs=1.5)
            assert not values[: int((11.45 - 0.5) / 0.0295)].any()
    assert max(sums, key=lambda angle: sums[angle]) == pytest.approx(0.5 * pi, abs=radians(1.0))
    assert sums[-pi] == 0.0


def test_a_scanning_sonar_device_gives_intensities() -> None:
    sensors = read_sensors({"scanning_sonar": {"device": "ping360"}}, "test")
    assert sensors["scanning_sonar"].offloaded
    assert sensors["scanning_sonar"].model.bins == 1200
    assert not any(sensor.offloaded for sensor in read_sensors({"scanning_sonar": {}}, "test").values())
    model, state = sensors["scanning_sonar"].model, State((0.0, 0.0, 18.0))
    samples = [ScanningSonar(model, Mounting(), 3, scene(FLAT)).sample(0, state) for _ in range(2)]
    assert samples[0] == samples[1]
    assert samples[0].echoes.encoding == "uint8"
    assert len(set(samples[0].echoes.intensities)) > 20


def test_a_scanning_sonar_has_a_tall_beam() -> None:
    """A 25 deg tall beam 3 m above a flat seabed meets it at 3 m / sin(12.5 deg), a thin one never."""
    world, state = FLAT, State((0.0, 0.0, 17.0))
    tall = ScanningSonar(ScanningSonarModel(ground_truth=True), Mounting(), 1, scene(world)).sample(0, state)
    assert tall.ranges[0] == pytest.approx(3.0 / sin(radians(12.5)), rel=1e-6)
    assert ScanningSonar(SONAR, Mounting(), 1, scene(world)).sample(0, state).ranges == (inf,)
    ahead = SONAR._replace(ground_truth=False, rate=100.0, angle_min=0.0, angle_max=1e-3, step=1e-4)
    noisy = ScanningSonar(ahead._replace(error=ErrorModel(noise_density=0.01)), Mounting(), 1, scene(POOL))
    assert pstdev(noisy.sample(i, State((0.2, 0.3, 5.0))).ranges[0] for i in range(1000)) == pytest.approx(0.1, rel=0.1)


# --- log and altimeter

DVL = DvlModel(velocity=EXACT, range=EXACT, accuracy=EXACT)
ALTIMETER = AltimeterModel(error=EXACT)


@pytest.mark.parametrize("mounting", [Mounting(), ASKEW._replace(orientation=(0.1, -0.2, 0.8))])
def test_a_dvl_over_a_slope_has_exact_velocity_and_altitude(mounting: Mounting) -> None:
    """The beams' ranges are those to the slope; velocity is exact; altitude is at right angles to the slope."""
    state = State((1.0, 2.0, 5.0), from_euler(0.1, -0.15, 0.9), NU)
    dvl = Dvl(DVL, mounting, 1, scene(sloping_world()))
    position, attitude = mounting.world_position(state), mounting.attitude(state)
    for i, distance in enumerate(dvl._ranges(state)):
        angle, tilt = pi / 4.0 + i * pi / 2.0, DVL.tilt
        beam = rotate(attitude, (sin(tilt) * cos(angle), sin(tilt) * sin(angle), cos(tilt)))
        assert distance == pytest.approx(distance_to_slope(position, beam), abs=1e-6)
    sample = dvl.sample(0, state)
    height = (20.0 + 0.25 * position[0] - position[2]) / sqrt(1.0 + 0.25**2)
    assert sample.locked
    assert sample.altitude == pytest.approx(height, abs=1e-6)
    swing = mounting.velocity(NU)
    assert rotate(mounting.quaternion, sample.velocity) == pytest.approx(swing, abs=1e-9)


def test_a_dvl_beam_ends_on_a_block_and_lock_is_lost_out_of_reach() -> None:
    """One beam ends on a block; over a slope that falls away two of them find nothing any more, and lock is lost."""
    across = 15.0 * tan(DVL.tilt) / sqrt(2.0)
    world = FLAT._replace(box=(Box(across, across, 4.0, 4.0, top=16.0),))
    ranges = Dvl(DVL, Mounting(), 1, scene(world))._ranges(State((0.0, 0.0, 5.0)))
    assert ranges == pytest.approx([11.0 / cos(DVL.tilt), *[15.0 / cos(DVL.tilt)] * 3])
    short = DVL._replace(max_range=16.5)
    dvl = Dvl(short, Mounting(), 1, scene(sloping_world()))
    assert [x is None for x in dvl._ranges(State((0.0, 0.0, 5.0)))] == [True, False, False, True]
    assert not dvl.sample(0, State((0.0, 0.0, 5.0))).locked


def test_an_obstacle_out_of_reach_does_not_change_a_sample() -> None:
    """A formula is used while only the flat seabed is within reach; nearer, the rays, which give the same."""
    near = FLAT._replace(cylinder=(Cylinder(30.0, 0.0, 2.0),), box=(Box(-20.0, -20.0, 3.0, 3.0, 0.3, 15.0),))
    one, other = Dvl(DvlModel(), ASKEW, 5, scene()), Dvl(DvlModel(), ASKEW, 5, scene(near))
    rays = Dvl(DvlModel(), ASKEW, 5, scene(near))
    rays._ground.is_flat = lambda state, across: False  # type: ignore[method-assign]
    for i in range(50):
        state = State((0.3 * i - 8.0, 0.1 * i, 3.0 + 0.1 * i), from_euler(0.01 * i, -0.008 * i, 0.3 * i), NU)
        first, second, third = (dvl.sample(i, state) for dvl in (one, other, rays))
        assert repr(first) == repr(second)
        assert (third.altitude, *third.velocity) == pytest.approx((first.altitude, *first.velocity), abs=1e-9)


def test_the_ground_is_flat_only_without_obstacles_in_reach() -> None:
    world = FLAT._replace(cylinder=(Cylinder(10.0, 0.0, 2.0),))
    ground = Dvl(DVL, Mounting(), 1, scene(world))._ground
    for north in [0.5 * i for i in range(30)]:
        state = State((north, 4.0 - 0.4 * north, 5.0))
        assert ground.is_flat(state, 3.0) == (world.clearance(*state.position[:2]) > 3.0)
    assert not Dvl(DVL, Mounting(), 1, scene(sloping_world()))._ground.is_flat(State((0.0, 0.0, 5.0)), 0.0)


def test_an_altimeter_measures_relief_and_obstacles() -> None:
    state = State((1.0, 2.0, 5.0), from_euler(0.15, -0.2, 2.0), NU)
    sample = Altimeter(ALTIMETER, ASKEW, 1, scene(sloping_world())).sample(0, state)
    beam = rotate(ASKEW.attitude(state), (0.0, 0.0, 1.0))
    assert sample.distance == pytest.approx(distance_to_slope(ASKEW.world_position(state), beam), abs=1e-6)
    stump = FLAT._replace(cylinder=(Cylinder(0.0, 0.0, 2.0, top=12.0),))
    altimeter = Altimeter(ALTIMETER, Mounting(), 1, scene(stump))
    assert altimeter.sample(0, State((0.0, 1.0, 5.0))).distance == pytest.approx(7.0)
    assert altimeter.sample(0, State((0.0, 3.0, 5.0))).distance == pytest.approx(15.0)
    ahead = Altimeter(ALTIMETER, Mounting(orientation=(0.0, pi / 2.0, 0.0)), 1, scene(stump))
    assert ahead.sample(0, State((-20.0, 0.0, 13.0))).distance == pytest.approx(18.0)
    assert ahead.sample(0, State((-20.0, 0.0, 11.0))).distance == inf
