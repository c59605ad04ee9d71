"""Covariances in messages: those of the error models, compared with the scatter of many measurements."""

from collections.abc import Sequence
from math import nan, radians
from statistics import mean
from typing import Any

import pytest

from hil.ros import encoders as ros
from hil.ros import message as ros_message
from hil.ros.topics import TOPICS
from sim.dynamics import State
from sim.environment.world import load_world
from sim.rotations import from_euler
from sim.sensors.ahrs import AhrsModel
from sim.sensors.error import ErrorModel, variance
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.dvl import Dvl, DvlModel
from sim.sensors.samples import DvlSample
from sim.sensors.sensor_set import SensorSpec, select_sensors
from sim.sensors.variances import error_variances
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle
from tests.support.fitted import NU

VEHICLE, WORLD = load_vehicle("paper_six")[0], load_world("pool")
DEPTH = 2.0
RUNS = 200  # the variance of so many is known to a tenth (1 sigma); the random numbers are always the same
QUICK = AhrsModel(rate=20.0, level_time=1.0, heading_time=1.0)  # it has settled after 100 samples


def simulation(sensors: Any = None) -> Simulation:
    return Simulation(VEHICLE, WORLD, dt_ns=2_500_000, position=(4.0, 4.0, DEPTH), sensors=sensors)


def at_rest() -> State:
    return State((4.0, 4.0, DEPTH))


def mean_squares(rows: Sequence[Sequence[float]]) -> list[float]:
    return [mean(x * x for x in column) for column in zip(*rows, strict=True)]


@pytest.mark.parametrize(("name", "samples"), [("imu", 1), ("ahrs", 100)])
def test_the_covariance_of_an_inertial_unit_matches_its_scatter(name: str, samples: int) -> None:
    sensors = select_sensors(ahrs=QUICK)
    fitted, scene, rows = sensors[name], simulation(), []
    for seed in range(RUNS):
        unit = fitted.sensor(fitted.model, Mounting(), seed, scene)
        for number in range(samples):
            sample: Any = unit.sample(number * 50_000_000, at_rest())
        _, x, y, z = sample.orientation
        a, b, c = sample.acceleration
        rows.append((2.0 * x, 2.0 * y, 2.0 * z, *sample.angular_velocity, a, b, c + WORLD.gravity))
    level, heading, rate, force = error_variances(sensors, WORLD)[name]
    assert mean_squares(rows) == pytest.approx([level, level, heading, *[rate] * 3, *[force] * 3], rel=0.35)


@pytest.mark.parametrize(("lost_beam", "roll"), [(None, 0.0), (0, 0.0), (3, 0.0), (None, 25.0), (1, -30.0)])
def test_the_covariance_of_a_dvl_matches_its_scatter(
    lost_beam: int | None, roll: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It also does if the sensor is tilted: there, the longest beam has the greatest errors."""
    velocity, distance = ErrorModel(noise=0.02, noise_share=0.02), ErrorModel(noise=0.004, noise_share=0.002)
    model = DvlModel(velocity=velocity, range=distance, accuracy=ErrorModel(noise=0.01), noise_range=2.0)
    log = Dvl(model, Mounting(), 3, simulation())
    state = State((4.0, 4.0, DEPTH), from_euler(radians(roll), radians(0.4 * roll), 0.0), NU)
    if lost_beam is not None:
        whole = log._ranges
        monkeypatch.setattr(
            log, "_ranges", lambda state: [None if at == lost_beam else x for at, x in enumerate(whole(state))]
        )
    samples = [log.sample(number, state) for number in range(3000)]
    rows = [[x - y for x, y in zip(sample.velocity, NU, strict=False)] for sample in samples]
    found = [mean(row[i] * row[j] for row in rows) for i in range(3) for j in range(3)]
    reported: Sequence[float] = [mean(column) for column in zip(*[s.covariance for s in samples], strict=True)]
    assert found == pytest.approx(reported, rel=0.12, abs=0.03 * reported[0])
    truth = mean(sample.altitude for sample in samples)
    of_altitude = mean(s.altitude_variance for s in samples)
    assert mean((s.altitude - truth) ** 2 for s in samples) == pytest.approx(of_altitude, rel=0.12)


def output(sensors: Any) -> dict[str, dict[str, Any]]:
    """Return the first message of each topic of a sensors, by its fields."""
    vehicle, variances, messages = simulation(sensors), error_variances(sensors, WORLD), dict[str, dict[str, Any]]()
    for _ in range(480):
        for topic, sample in vehicle.step((1500,) * 6):
            for name, payload in ros.encoder(topic)(sample, "", *variances.get(topic, ())):
                message = ros_message.decode(TOPICS[name].type, payload)
                assert message is not None
                messages.setdefault(name, message)
    return messages


def diagonal(values: Sequence[float]) -> list[float]:
    size = round(len(values) ** 0.5)
    assert [x for at, x in enumerate(values) if abs(x) > 1e-15 and at % (size + 1)] == [], "only its diagonal"
    return [values[axis * (size + 1)] for axis in range(size)]


def test_every_message_with_a_covariance_field_fills_it() -> None:
    from sim.sensors.magnetometer import Magnetometer, MagnetometerModel
    from sim.sensors.ranging.altimeter import Altimeter, AltimeterModel
    from sim.sensors.ranging.echosounder import Echosounder, EchosounderModel

    sensors = select_sensors(
        ahrs=QUICK,
        altimeter=SensorSpec(Altimeter, AltimeterModel()),
        echosounder=SensorSpec(Echosounder, EchosounderModel()),
        magnetometer=SensorSpec(Magnetometer, MagnetometerModel()),
    )
    models: Any = {name: fitted.model for name, fitted in sensors.items()}

    def of(name: str, key: str) -> float:
        return variance(getattr(models[name], key), 1.0 / models[name].rate)

    messages = output(sensors)
    imu, odometry = messages["imu"], messages["odom"]
    assert diagonal(imu["orientation_covariance"]) == [of("imu", "attitude")] * 3
    assert diagonal(imu["angular_velocity_covariance"]) == [of("imu", "angular_velocity")] * 3
    assert diagonal(imu["linear_acceleration_covariance"]) == [of("imu", "acceleration")] * 3
    level, heading, *_ = error_variances(sensors, WORLD)["ahrs"]
    assert diagonal(messages["ahrs"]["orientation_covariance"]) == [level, level, heading]
    pose = [of("odometry", key) for key in ("horizontal", "horizontal", "depth")]  # east, north, up
    assert diagonal(odometry["pose"]["covariance"]) == [*pose, *[of("odometry", "attitude")] * 3]
    twist = [*[of("odometry", "velocity")] * 3, *[of("odometry", "angular_velocity")] * 3]
    assert diagonal(odometry["twist"]["covariance"]) == twist
    assert messages["pressure"]["variance"] == of("pressure", "error")
    for name in ("altimeter", "echosounder"):
        assert messages[name]["variance"] == pytest.approx(of(name, "error"), rel=1e-6)
    field = [of("magnetometer", key) for key in ("error_xy", "error_xy", "error_z")]
    assert diagonal(messages["magnetometer"]["magnetic_field_covariance"]) == field
    assert messages["dvl"]["velocity_covar"][0] > 0.0 < messages["altitude"]["variance"]
    assert diagonal(messages["dvl_twist"]["twist"]["covariance"])[3:] == [-1.0] * 3, "nothing is known of turning"
    assert not any(messages["ground_truth"]["pose"]["covariance"]), "the truth has no errors"


def test_the_covariance_of_a_dvl_is_rotated_to_ros_axes() -> None:
    covariance = (1.0, 0.1, 0.2, 0.1, 2.0, 0.3, 0.2, 0.3, 3.0)
    sample = DvlSample(1, (0.1, 0.2, 0.3), 5.0, True, covariance, 0.25)
    payloads = dict(ros.encoder("dvl")(sample, ""))
    messages: Any = {name: ros_message.decode(TOPICS[name].type, payload) for name, payload in payloads.items()}
    assert messages["dvl"]["velocity_covar"] == covariance
    rows = messages["dvl_twist"]["twist"]["covariance"]
    assert [*rows[0:3], *rows[6:9], *rows[12:15]] == [1.0, -0.1, -0.2, -0.1, 2.0, 0.3, -0.2, 0.3, 3.0]
    assert messages["altitude"]["variance"] == 0.25
    lost = sample._replace(velocity=(nan,) * 3, altitude=nan, locked=False)
    gone: Any = ros_message.decode(TOPICS["dvl"].type, dict(ros.encoder("dvl")(lost, ""))["dvl"])
    assert gone["velocity_covar"][0] == -1.0
