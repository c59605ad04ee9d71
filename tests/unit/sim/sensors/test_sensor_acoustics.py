"""Altimeter, acoustic positions, current meter and water track."""

from math import cos, dist, hypot, inf, isnan, radians

import numpy as np
import pytest

from sim.dynamics import State
from sim.environment.ocean import Layers, Ocean, Profile, Waves
from sim.environment.seawater.sound_rays import SoundRays
from sim.environment.world import World
from sim.rotations import from_euler, rotate, rotate_inverse
from sim.sensors.current_meter import CurrentMeter, CurrentMeterModel
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.altimeter import Altimeter, AltimeterModel
from sim.sensors.ranging.dvl_water import DvlWater, DvlWaterModel
from sim.sensors.sensor_set import SensorSpec
from sim.sensors.usbl import Usbl, UsblModel, rotate_direction
from sim.simulation import Simulation
from tests.support.fitted import ASKEW, EXACT, NU, VEHICLE, scene

SEA = World("sea", "test", (-900.0, 900.0, -900.0, 900.0), 20.0, current=(0.3, -0.2, 0.05))
DEEP = SEA._replace(depth=1000.0)


# --- altimeter

ALTIMETER = AltimeterModel(error=EXACT)


def test_an_altimeter_measures_along_its_beam() -> None:
    state = State((1.0, 2.0, 3.0), from_euler(0.15, -0.2, 2.0), NU)
    straight = Altimeter(ALTIMETER, Mounting((0.4, 0.1, 0.3)), 1, scene(SEA)).sample(9, state)
    depth = 3.0 + rotate(state.quaternion, (0.4, 0.1, 0.3))[2]
    assert straight.time_ns == 9
    assert straight.distance == pytest.approx((20.0 - depth) / (cos(0.15) * cos(0.2)))
    assert straight.limits == (0.3, 100.0)
    ahead = Mounting(orientation=(0.0, radians(60), 0.0))  # tips the beam ahead by 60 deg
    level = State((0.0, 0.0, 5.0))
    assert Altimeter(ALTIMETER, ahead, 1, scene(SEA)).sample(0, level).distance == pytest.approx(30.0)


@pytest.mark.parametrize(
    ("depth", "roll", "expected"),
    [
        (5.0, 0.0, 15.0),
        (19.8, 0.0, -inf),  # too near
        (-0.1, 0.0, inf),  # in the air
        (5.0, radians(90), inf),  # along the seabed
        (5.0, radians(180), inf),
        (5.0, radians(82), inf),  # 108 m: too far
        (5.0, radians(81), 15.0 / cos(radians(81))),
    ],
)
def test_an_altimeter_without_an_echo_gives_no_altitude(depth: float, roll: float, expected: float) -> None:
    state = State((0.0, 0.0, depth), from_euler(roll, 0.0, 0.0))
    assert Altimeter(ALTIMETER, Mounting(), 1, scene(SEA)).sample(0, state).distance == pytest.approx(expected)


# --- USBL

USBL = UsblModel(range=EXACT, angle=EXACT, station=(10.0, -20.0, 2.0))


@pytest.mark.parametrize("position", [(100.0, 200.0, 30.0), (10.0, -20.0, 2.0)])
def test_a_usbl_is_exact_without_errors(position: tuple[float, float, float]) -> None:
    state = State(position, from_euler(0.3, -0.5, 2.0), NU)
    sample = Usbl(USBL, ASKEW, 1, scene(DEEP)).sample(5, state)
    assert sample is not None
    assert sample.time_ns == 5
    assert sample.position == pytest.approx(ASKEW.world_position(state), rel=1e-12)


@pytest.mark.parametrize("line", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.6, 0.0, 0.8), (0.48, -0.64, -0.6)])
def test_a_direction_turns_by_its_angles_down_and_to_starboard(line: tuple[float, float, float]) -> None:
    turned = [rotate_direction(line, 1e-4, 0.0), rotate_direction(line, 0.0, 2e-4)]
    assert np.linalg.norm(turned, axis=1) == pytest.approx([1.0, 1.0], abs=1e-15)
    to_down, to_starboard = np.subtract(turned, line)
    assert np.linalg.norm(to_starboard) == pytest.approx(2e-4)
    assert np.cross(line, to_starboard) == pytest.approx(2.0 * to_down, abs=1e-7)
    assert to_starboard[2] == pytest.approx(0.0, abs=1e-7)
    assert to_down[2] > 0.0 or abs(line[2]) == 1.0


@pytest.mark.parametrize("position", [(0.0, 0.0, -1.0), (1200.0, 0.0, 5.0), (10.0, -20.0, 2.0)])
def test_a_usbl_has_no_fix_in_air_out_of_reach_or_at_its_station(position: tuple[float, float, float]) -> None:
    """There is no fix in the air, out of reach, and at the station itself."""
    assert Usbl(USBL, Mounting(), 1, scene(DEEP)).sample(0, State(position)) is None


@pytest.mark.parametrize("latency", [0.0, 0.25])
@pytest.mark.parametrize(
    ("ocean", "speed"),
    [(None, 1500.0), (Ocean(profile=Profile((0.0, 200.0), (1025.0, 1027.0), (1520.0, 1480.0))), 1505.0)],
)
def test_usbl_samples_arrive_after_the_travel_time(ocean: Ocean | None, speed: float, latency: float) -> None:
    """A fix from 600 m away, both at 75 m, takes 0.4 s on average and the latency; its stamp is the ping's."""
    station = (600.0, 0.0, 75.0)
    fitted = SensorSpec(Usbl, USBL._replace(station=station, rate=2.0), Mounting(latency=latency))
    world = DEEP._replace(ocean=ocean, current=(0.0, 0.0, 0.0))
    simulation = Simulation(VEHICLE, world, {"usbl": fitted}, position=(0.0, 0.0, 75.0))
    arrived = [(simulation.time_ns, sample) for _ in range(720) for _, sample in simulation.step((1500,) * 8)]
    assert [sample.time_ns for _, sample in arrived] == [500_000_000, 1_000_000_000]
    for now, sample in arrived:
        delay = (now - sample.time_ns) * 1e-9
        assert 600.0 / speed + latency <= delay < 600.0 / speed + latency + 0.0026


SLOWER_BELOW = Ocean(profile=Profile((0.0, 200.0), (1025.0, 1027.0), (1520.0, 1480.0)))


def test_a_usbl_measures_range_and_direction_along_the_refracted_ray() -> None:
    """The range is the station's speed of sound times the travel time; the position is off by the ray's curvature."""
    position, station = (600.0, 80.0, 90.0), (0.0, 0.0, 40.0)
    world = DEEP._replace(ocean=SLOWER_BELOW)
    sample = Usbl(USBL._replace(station=station), Mounting(), 1, scene(world)).sample(0, State(position))
    ray = SoundRays((0.0, 200.0), (1520.0, 1480.0)).between(hypot(600.0, 80.0), 40.0, 90.0)
    assert sample is not None
    assert ray is not None
    off = [a - b for a, b in zip(sample.position, station, strict=True)]
    assert hypot(*off) == pytest.approx(ray.time * 1512.0)
    assert off[2] / hypot(*off) == pytest.approx(ray.departure)
    assert off[1] / off[0] == pytest.approx(80.0 / 600.0)
    assert sample.position[2] < 85.0, "sound that leaves more level comes down to it"
    assumed = Usbl(USBL._replace(station=station, assumed_speed=1500.0), Mounting(), 1, scene(world))
    sample = assumed.sample(0, State(position))
    assert sample is not None
    assert dist(sample.position, station) == pytest.approx(ray.time * 1500.0)


def test_a_usbl_has_no_fix_in_a_shadow_zone() -> None:
    """Rays that bend down in a gradient of -0.2 /s leave a beacon 3 m deep without sound from 500 m away."""
    world = DEEP._replace(ocean=SLOWER_BELOW)
    usbl = Usbl(USBL._replace(station=(0.0, 0.0, 3.0)), Mounting(), 1, scene(world))
    assert usbl.sample(0, State((350.0, 0.0, 3.0))) is not None
    assert usbl.sample(1, State((500.0, 0.0, 3.0))) is None


def test_a_wrong_assumed_speed_of_sound_scales_usbl_ranges() -> None:
    usbl = Usbl(USBL._replace(station=(0.0, 0.0, 5.0), assumed_speed=1515.0), Mounting(), 1, scene(DEEP))
    sample = usbl.sample(0, State((300.0, 0.0, 5.0)))
    assert sample is not None
    assert sample.position == pytest.approx((303.0, 0.0, 5.0))
    assert USBL._replace(assumed_speed=1300.0).validate() is None


# --- water

METER = CurrentMeterModel(velocity=EXACT)


@pytest.mark.parametrize("mounting", [Mounting(), ASKEW])
def test_a_current_meter_is_exact_without_errors(mounting: Mounting) -> None:
    """The sample is water less vehicle velocity at the meter's position, by hand with the lever arm."""
    state = State((1.0, 2.0, 3.0), from_euler(0.15, -0.2, 2.0), NU)
    sample = CurrentMeter(METER, mounting, 1, scene(SEA)).sample(4, state)
    assert sample is not None
    swing = np.array(NU[:3]) + np.cross(NU[3:], mounting.position)
    past = np.array(SEA.current) - np.array(rotate(state.quaternion, swing.tolist()))
    axes = from_euler(*mounting.orientation)
    assert sample.time_ns == 4
    assert sample.velocity == pytest.approx(rotate_inverse(axes, rotate_inverse(state.quaternion, past.tolist())))


def test_a_current_meter_measures_waves_at_its_position_and_nothing_in_air() -> None:
    world = SEA._replace(ocean=Ocean(waves=Waves(1.0, 6.0, components=3)), current=(0.0, 0.0, 0.0))
    simulation = scene(world)
    meter = CurrentMeter(METER, Mounting((0.0, 0.0, 2.0)), 1, simulation)
    sample, wave_field = meter.sample(0, State((3.0, 4.0, 1.0))), simulation.wave_field
    assert sample is not None
    assert wave_field is not None
    assert sample.velocity == pytest.approx(wave_field.motion(0.0, 3.0, 4.0, 3.0).velocity)
    assert meter.sample(0, State((3.0, 4.0, -4.0))) is None


TRACK = DvlWaterModel(velocity=EXACT, near=2.0, far=6.0)


@pytest.mark.parametrize("mounting", [Mounting((0.3, -0.1, 0.2)), ASKEW._replace(orientation=(0.1, -0.1, 2.5))])
def test_water_track_is_relative_to_the_middle_of_its_layer(mounting: Mounting) -> None:
    """The current of the layer's middle counts where it grows with depth, not that at the vehicle."""
    layers = Layers((0.0, 20.0), (0.0, 2.0), (1.0, 0.0))
    simulation = scene(SEA._replace(ocean=Ocean(layers=layers), current=(0.0, 0.0, 0.0)))
    state = State((1.0, 2.0, 3.0), from_euler(0.15, -0.2, 2.0), NU)
    sample = DvlWater(TRACK, mounting, 1, simulation).sample(4, state)
    depth = mounting.depth(state) + 4.0 * rotate(mounting.attitude(state), (0.0, 0.0, 1.0))[2]
    flow = 0.1 * depth, 1.0 - 0.05 * depth, 0.0
    through = [v - x for v, x in zip(mounting.velocity(NU), rotate_inverse(state.quaternion, flow), strict=True)]
    assert sample.locked
    assert isnan(sample.altitude)
    assert sample.velocity == pytest.approx(rotate_inverse(from_euler(*mounting.orientation), through))


@pytest.mark.parametrize(
    ("depth", "roll", "locked"),
    [
        (5.0, 0.0, True),
        (12.4, 0.0, True),  # 80 % of 7.6 m is 6.08 m
        (12.6, 0.0, False),
        (12.6, radians(30), True),  # tilted, the layer ends higher
        (5.0, radians(100), False),
        (-0.1, 0.0, False),
    ],
)
def test_water_track_locks_within_its_limits(depth: float, roll: float, locked: bool) -> None:
    sample = DvlWater(TRACK, Mounting(), 1, scene(SEA)).sample(
        0, State((0.0, 0.0, depth), from_euler(roll, 0.0, 0.0), NU)
    )
    assert sample.locked is locked
    assert all(isnan(x) is not locked for x in sample.velocity)
