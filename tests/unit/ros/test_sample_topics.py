"""The table of topics of samples, compared with what the encoders make of every scalar sensor's samples."""

from hil.ros import encoders as ros
from hil.ros.topics import TOPICS, sample_topics
from sim.environment.world import load_world
from sim.sensors.kinds import SENSORS
from sim.sensors.sensor_set import load_sensor, select_sensors
from sim.sensors.variances import error_variances
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle

PICTURES = {"camera", "forward_sonar", "side_scan"}
NEEDS_A_BATTERY = {"battery"}  # which this vehicle has not


def test_samples_are_encoded_for_their_declared_topics() -> None:
    sensors = select_sensors(
        **{name: load_sensor(name).Model() for name in SENSORS if name not in PICTURES | NEEDS_A_BATTERY}
    )
    world = load_world("paper_field")._replace(origin=(57.7, 11.9))
    simulation = Simulation(load_vehicle("bluerov2")[0], world, position=(0.0, 0.0, 3.0), sensors=sensors)
    variances = error_variances(sensors, world)
    by_name: dict[str, tuple[str, ...]] = {}
    while simulation.time_ns < 2_000_000_000:
        for name, sample in simulation.step((1500,) * 6):
            by_name[name] = tuple(topic for topic, _ in ros.encoder(name)(sample, "", *variances.get(name, ())))
    assert set(by_name) >= {each.sensor.topic for name, each in sensors.items() if name != "usbl"}
    assert by_name == {name: sample_topics(name) for name in by_name}
    assert {topic for topics in by_name.values() for topic in topics} <= set(TOPICS)


def test_image_topics_are_declared_with_the_first_sample() -> None:
    """The topics of a camera depend on its options."""
    assert [sample_topics(name) for name in PICTURES] == [(), (), ()]
