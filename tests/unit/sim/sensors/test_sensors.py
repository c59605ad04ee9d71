"""IMU, DVL, pressure and odometry: exact without errors, and errors of their size."""

from math import cos, hypot, isnan, pi, radians
from statistics import pstdev
from typing import Any

import pytest

from hil.common.errors import ConfigError
from sim.dynamics import State
from sim.environment.world import World
from sim.matrices import inverse
from sim.rotations import from_euler, rotate, rotate_inverse
from sim.sensors.error import ErrorModel
from sim.sensors.imu import Imu, ImuModel, specific_force
from sim.sensors.mounting import Mounting
from sim.sensors.odometry import GroundTruth, GroundTruthModel, Odometry, OdometryModel
from sim.sensors.pressure import Pressure, PressureModel
from sim.sensors.ranging.altimeter import Altimeter, AltimeterModel
from sim.sensors.ranging.dvl import Dvl, DvlModel
from sim.sensors.sensor_set import Schedule, SensorSpec, read_sensors
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle
from tests.support.fitted import EXACT, NU, scene
from tests.support.flights.runge_kutta import RungeKutta

EXACT_IMU = ImuModel(attitude=EXACT, angular_velocity=EXACT, acceleration=EXACT)
EXACT_DVL = DvlModel(velocity=EXACT, range=EXACT, accuracy=EXACT)
PLAIN = Mounting()
SEA = World("sea", "test", (-100.0, 100.0, -100.0, 100.0), 20.0, gravity=9.8)
SCENE = scene(SEA)


def test_an_imu_at_rest_measures_gravity_upwards() -> None:
    sample = Imu(EXACT_IMU, PLAIN, 1, SCENE).sample(5, State())
    assert sample == (5, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -9.8))
    nose_up = State(quaternion=from_euler(0.0, radians(90), 0.0))
    assert Imu(EXACT_IMU, PLAIN, 1, SCENE).sample(5, nose_up).acceleration == pytest.approx((9.8, 0.0, 0.0))


def test_specific_force_is_the_acceleration_of_the_sensors_position() -> None:
    """The specific force is the second difference of the sensor's position, in fast motion in a current."""
    vehicle, _ = load_vehicle("bluerov2_heavy")
    dynamics = RungeKutta(vehicle, 1025.0, 9.8)
    state, position, dt = State((0, 0, 50.0), from_euler(0.3, -0.2, 0.7), NU), (0.2, -0.1, 0.3), 0.001

    def world() -> list[float]:
        return [a + b for a, b in zip(state.position, rotate(state.quaternion, position), strict=True)]

    def step() -> None:
        dynamics.step(state, (40.0, -20.0, 30.0, 2.0, -3.0, 4.0), (0.3, -0.2, 0.1), dt)

    for _ in range(300):
        step()
    before = world()
    step()
    middle, at = world(), (list(state.quaternion), list(state.nu))
    step()
    after = world()
    felt = State(quaternion=at[0], nu=at[1])
    felt.nu_dot = [(b - a) / dt for a, b in zip(at[1], state.nu, strict=True)]
    seen = [(a - 2.0 * b + c) / dt**2 for a, b, c in zip(before, middle, after, strict=True)]
    expected = rotate_inverse(at[0], (seen[0], seen[1], seen[2] - 9.8))
    assert specific_force(felt, position, 9.8) == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("orientation", [(0.0, 0.0, 0.0), (0.0, 0.0, pi / 4.0), (0.1, -0.15, 2.5), (0.0, 0.0, -1.0)])
def test_a_dvl_is_exact_without_errors(orientation: tuple[float, float, float]) -> None:
    """The velocity of a tilted, turning DVL off the origin is that of its position; its altitude is over the seabed."""
    q, position = from_euler(0.15, -0.2, 2.0), (0.3, -0.1, 0.2)
    state = State((1.0, 2.0, 3.0), q, NU)
    sample = Dvl(EXACT_DVL, Mounting(position, orientation), 1, SCENE).sample(9, state)
    u, v, w, p, q_, r = NU
    x, y, z = position
    assert sample.locked
    swing = u + q_ * z - r * y, v + r * x - p * z, w + p * y - q_ * x
    assert sample.velocity == pytest.approx(rotate_inverse(from_euler(*orientation), swing))
    assert sample.altitude == pytest.approx(20.0 - 3.0 - rotate(q, position)[2])
    slant = 17.0 / cos(EXACT_DVL.tilt)  # what the mean of the beams would be, level
    assert abs(sample.altitude - slant) > 1.0


@pytest.mark.parametrize(
    ("depth", "roll", "locked"),
    [
        (5.0, 0.0, True),
        (19.9, 0.0, False),  # too near the seabed
        (-1.0, 0.0, False),  # out of the water
        (5.0, radians(179), False),  # beams to the sky
        (5.0, radians(60), False),  # two beams above the horizon
    ],
)
def test_a_dvl_locks_within_its_limits(depth: float, roll: float, locked: bool) -> None:
    sample = Dvl(DvlModel(), PLAIN, 1, SCENE).sample(0, State((0.0, 0.0, depth), from_euler(roll, 0.0, 0.0), NU))
    assert sample.locked is locked
    assert isnan(sample.altitude) is not locked
    assert all(isnan(x) is not locked for x in sample.velocity)


def test_a_dvl_with_three_beams_gives_velocity_and_altitude() -> None:
    """One beam loses the seabed over a slope; three still give velocity and altitude."""
    model = EXACT_DVL._replace(max_range=23.0)
    state = State((0.0, 0.0, 0.5), from_euler(0.11, 0.11, 0.0), NU)
    dvl = Dvl(model, PLAIN, 1, SCENE)
    assert sum(distance is None for distance in dvl._ranges(state)) == 1
    sample = dvl.sample(0, state)
    assert sample.velocity == pytest.approx(NU[:3])
    assert sample.altitude == pytest.approx(19.5)


def test_a_beam_without_lock_does_not_contribute() -> None:
    """The error with three beams is that of each beam: the three measured speeds and distances are met exactly."""
    model = DvlModel(max_range=23.0, velocity=ErrorModel(offset=0.1), range=ErrorModel(offset=0.5), accuracy=EXACT)
    dvl = Dvl(model, PLAIN, 1, SCENE)
    state = State((0.0, 0.0, 0.5), from_euler(0.11, 0.11, 0.0), NU)
    sample = dvl.sample(0, state)
    locked = [(beam, found) for beam, found in zip(dvl._beams, dvl._ranges(state), strict=True) if found is not None]
    for (x, y, z), _ in locked:
        u, v, w = (found - true for found, true in zip(sample.velocity, NU[:3], strict=True))
        assert x * u + y * v + z * w == pytest.approx(0.1)
    ends = [[(found + 0.5) * x for x in beam] for beam, found in locked]
    normal = [sum(row) for row in inverse(ends)]  # of the plane through them: normal . end = 1
    assert sample.altitude == pytest.approx(1.0 / hypot(*normal))


def test_pressure_is_hydrostatic_at_the_sensor_with_noise() -> None:
    sensor = Pressure(PressureModel(error=EXACT), Mounting((0.1, 0.0, 0.2)), 1, SCENE)
    assert sensor.sample(3, State((0, 0, 10.0))).time_ns == 3
    assert sensor.sample(3, State((0, 0, 10.0))).pascal == pytest.approx(101_325.0 + 1025.0 * 9.8 * 10.2, rel=5e-5)
    assert sensor.sample(3, State((0, 0, -1.0))).pascal == 101_325.0
    tipped = State((0, 0, 10.0), from_euler(0.0, radians(-90), 0.0))
    assert sensor.sample(3, tipped).pascal == pytest.approx(101_325.0 + 1025.0 * 9.8 * 10.1, rel=5e-5)
    noisy = Pressure(PressureModel(), PLAIN, 1, SCENE)
    assert pstdev([noisy.sample(i, State()).pascal for i in range(500)]) == pytest.approx(20.0, rel=0.5)


def test_odometry_has_errors_and_ground_truth_is_exact() -> None:
    state = State((1.0, 2.0, 3.0), from_euler(0.1, 0.2, 0.3), NU)
    exact = GroundTruth(GroundTruthModel(), PLAIN, 1, SCENE).sample(7, state)
    assert exact == (7, (1.0, 2.0, 3.0), from_euler(0.1, 0.2, 0.3), NU)
    assert Odometry(OdometryModel(20.0, EXACT, EXACT, EXACT, EXACT, EXACT), PLAIN, 1, SCENE).sample(7, state) == exact
    odometry = Odometry(OdometryModel(), PLAIN, 1, SCENE)
    samples = [odometry.sample(i, state) for i in range(20_000)]  # 1000 s
    north = [sample.position[0] for sample in samples]
    assert pstdev(north) == pytest.approx((0.1**2 + 0.02**2) ** 0.5, rel=0.3)
    assert min(north) < 0.85  # to both sides
    assert max(north) > 1.15
    assert pstdev([sample.nu[0] for sample in samples]) == pytest.approx(0.01, rel=0.05)


def test_samples_are_late_and_lost_as_their_mountings_have_it() -> None:
    """Each arrives by its own latency, also while an earlier one of a slower sensor is on its way."""
    losing = Mounting(latency=0.05, drop_out=0.5, drop_out_from=2.0, drop_out_until=4.0)
    fitted = {
        "altimeter": SensorSpec(Altimeter, AltimeterModel(rate=100.0), Mounting(latency=0.2, jitter=0.1)),
        "pressure": SensorSpec(Pressure, PressureModel(rate=100.0), losing),
    }
    schedule, arrived = Schedule(fitted, SCENE, 1, 10**6), []
    for now in range(0, 6 * 10**9, 10**6):
        if now >= schedule.due_ns:
            arrived += [(topic, now, sample.time_ns) for topic, sample in schedule.pop_due(now, SCENE)]
    late = [now - taken for topic, now, taken in arrived if topic == "altimeter"]
    assert [min(late), sum(late) / len(late), max(late)] == pytest.approx([2e8, 2.5e8, 3e8], abs=5e6)
    assert {now - taken for topic, now, taken in arrived if topic == "pressure"} == {50_000_000}
    lost = {*range(10**7, 59 * 10**8, 10**7)} - {taken for topic, _, taken in arrived if topic == "pressure"}
    assert 80 < len(lost) < 120
    assert min(lost) >= 2 * 10**9 > max(lost) - 2 * 10**9


class Gauge:
    message = "std_msgs/msg/Float64"

    def __init__(self, scale: float) -> None:
        self._scale = scale

    def begin(self, *scene_mounting_random: Any) -> None:
        self._values = {"data": self._scale * scene_mounting_random[1].position[2]}

    def sample(self, time_ns: int, state: State) -> dict[str, float] | None:
        return self._values if time_ns % 20_000_000 else None


def test_a_users_own_sensor_gets_its_keys() -> None:
    section = {"class": f"{__name__}:Gauge", "rate": 100, "scale": 2.0, "position": [0.0, 0.0, 0.5]}
    simulation = Simulation(load_vehicle("paper_six")[0], SEA, read_sensors({"gauge": section}, "f"))
    samples: list[Any] = [each for _ in range(13) for each in simulation.step([1500] * 6)]
    assert [each for each in samples if each[0] == "gauge"] == [
        ("gauge", (n, {"data": 1.0})) for n in (10**7, 3 * 10**7)
    ]
    for name, wrong in (
        ("gauge", {"class": section["class"]}), ("gauge", {"sensor": "gauge"}), ("gauge", {"sensor": "odometry"}),
        ("altimeter", {"min_range": 9, "max_range": 9}), ("echosounder", {"min_range": 9, "max_range": 9}),
        ("dvl_water", {"near": 2, "far": 2}), ("usbl", {"assumed_speed": 1299}), ("imu", {"sensor": "dvl"}),
        ("größe", section), ("eye", {"sensor": ["camera"]}), ("mute", {"class": "builtins:object", "rate": 1}),
    ):  # fmt: skip
        with pytest.raises(ConfigError, match=f"f: {name}: "):
            read_sensors({name: wrong}, "f")
    assert read_sensors({"eye": {"sensor": "camera"}}, "f")["eye"].topic == "eye"
    simulation.place((1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), NU)
    assert list(simulation.state.nu_dot) == [0.0] * 6
