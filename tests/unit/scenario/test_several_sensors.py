"""Several sensors of one kind in a scenario, each with a name of its own for its topics and frames."""

from pathlib import Path

import pytest

from hil.common.errors import ConfigError
from hil.ros import encoders as ros
from hil.ros.graph import ros_name
from hil.ros.message import decode
from hil.ros.own import announce
from hil.ros.topics import TOPICS, first_of, further_topics, learn, sample_topics
from hil.scenario.config import load_scenario
from hil.scenario.records import Ros
from hil.slave.ros.node import static_transforms
from sim.dynamics import State
from sim.environment.world import load_world
from sim.sensors.extra_samples import FlagSample
from sim.sensors.imaging.samples import CameraSample, Intrinsics
from sim.sensors.samples import DvlSample, ImuSample
from sim.sensors.sensor_set import SensorSet, Slot, read_sensors, select_sensors
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle

SECTIONS = {
    "camera": {"rate": 5, "width": 8, "height": 6},
    "camera_down": {"sensor": "camera", "rate": 2, "width": 8, "height": 6, "position": [0.1, 0.0, 0.2]},
    "aft": {"sensor": "dvl"},
    "imu_2": {"sensor": "imu", "rate": "50 Hz", "latency": "5 ms"},
    "sonar_wide": {"sensor": "forward_sonar", "device": "oculus_m750d", "rate": 4},
}


def read_sections() -> SensorSet:
    read = read_sensors(SECTIONS, "mine.toml: sensors")
    announce(read, "mine.toml: sensors")
    return read


def test_each_sensor_has_its_own_keys_and_name() -> None:
    sensors = read_sections()
    assert sensors["camera_down"].model.rate == 2.0
    assert sensors["camera_down"].mounting.position == (0.1, 0.0, 0.2)
    assert sensors["camera_down"].topic == "camera_down"
    assert sensors["camera"].topic == "camera"
    assert sensors["sonar_wide"].model.rate == 4.0
    assert sensors["sonar_wide"].model.frequency == 750e3, "of the device"


def test_topics_are_those_of_the_kind_under_the_sensors_name() -> None:
    read_sections()
    assert TOPICS["camera_down/image_raw"].type == "sensor_msgs/msg/Image"
    assert TOPICS["sonar_wide/image"].type == TOPICS["forward_sonar/image"].type
    assert sample_topics("aft") == ("aft", "aft_twist", "aft_altitude")
    assert sample_topics("imu_2") == ("imu_2",)
    assert sample_topics("camera_down") == ()
    assert first_of("camera_down/depth/points") == "camera/depth/points"


def test_messages_have_the_topics_and_frames_of_the_sensors_name() -> None:
    read_sections()
    pixels = CameraSample(10**9, 2, 1, bytes(6), bytes(8), None, Intrinsics(1, 1, 0, 0), (0.0,) * 5)
    images = dict(ros.encoder("camera_down")(pixels, "uuv1/", "raw", 80))
    assert set(images) == {
        "camera_down/camera_info", "camera_down/image_raw", "camera_down/depth/camera_info",
        "camera_down/depth/image_raw",
    }  # fmt: skip
    for topic, payload in images.items():
        fields = decode(TOPICS[topic].type, payload)
        assert fields
        assert fields["header"]["frame_id"] == "uuv1/camera_down_optical_frame"
        assert ros.decoder(topic)(payload) is not None  # type: ignore[misc]
    velocity = DvlSample(10**9, (1.0, 2.0, 3.0), 4.0, True)
    payloads = dict(ros.encoder("aft")(velocity, ""))
    assert set(payloads) == {"aft", "aft_twist", "aft_altitude"}
    assert ros.decoder("aft_altitude")(payloads["aft_altitude"]).distance == 4.0  # type: ignore[misc]
    turning = ImuSample(10**9, (1.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3), (0.0, 0.0, -9.8))
    ((topic, payload),) = ros.encoder("imu_2")(turning, "", 1.0, 1.0, 1.0, 1.0)
    assert topic == "imu_2"
    fields = decode(TOPICS[topic].type, payload)
    assert fields
    assert fields["header"]["frame_id"] == "imu_2_link"


def test_each_sensor_has_its_frame_in_the_transforms() -> None:
    frames = {each.child: each for each in static_transforms(read_sections(), Ros(), 0)}
    assert {"camera_link", "camera_optical_frame", "camera_down_link", "camera_down_optical_frame"} <= set(frames)
    assert {"aft_link", "aft_transducer_link", "sonar_wide_fan", "imu_2_link"} <= set(frames)
    assert frames["camera_down_optical_frame"].frame == "camera_down_link"


def test_each_sensor_has_its_own_random_numbers() -> None:
    sections = {"pressure_2": {"sensor": "pressure"}}
    scene = Simulation(load_vehicle("bluerov2")[0], load_world("open_water"), {})
    read = read_sensors(sections, "")
    one, other, usual = (
        Slot(n, s[n], scene, 1, 1).sensor
        for n, s in (("pressure", read), ("pressure_2", read), ("pressure", select_sensors()))
    )
    state = State()
    values = [[sensor.sample(0, state).pascal for _ in range(3)] for sensor in (one, other, usual)]  # type: ignore[union-attr]
    assert values[0] == values[2]
    assert values[0] != values[1]


def test_echoes_of_a_second_scanning_sonar_have_their_own_noise() -> None:
    keys = {"bins": 50, "max_range": 20.0}
    read = read_sensors({"scanning_sonar": keys, "sonar_aft": {"sensor": "scanning_sonar", **keys}}, "")
    scene = Simulation(load_vehicle("bluerov2")[0], load_world("slope"), {}, position=(0.0, 0.0, 2.0))
    one, other = (Slot(name, read[name], scene, 1, 1).sensor for name in ("scanning_sonar", "sonar_aft"))
    echoes = [sensor.sample(0, scene.state).echoes for sensor in (one, other)]  # type: ignore[union-attr]
    assert echoes[0].intensities != echoes[1].intensities


@pytest.mark.parametrize(("sections", "topic"), [
    ({"motors": {"sensor": "camera"}}, "motors"),
    ({"altitude": {"sensor": "imu"}}, "altitude"),
    ({"aft": {"sensor": "dvl"}, "aft_twist": {"sensor": "imu"}}, "aft_twist"),
])  # fmt: skip
def test_a_topic_used_by_two_sensors_is_refused(sections: dict[str, object], topic: str) -> None:
    with pytest.raises(ConfigError, match=f"the topic '{topic}' is taken"):
        announce(read_sensors(sections, "sensors"), "sensors")
    assert "aft" not in TOPICS or topic != "motors"


def test_two_sensors_of_the_same_name_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('[sensors.down]\nsensor = "camera"\n[sensors.down]\nsensor = "imu"\n')
    with pytest.raises(ConfigError, match=r"down.*twice"):
        load_scenario(str(file))


def test_a_process_without_the_scenario_learns_a_topic_from_the_graph() -> None:
    assert learn("left/depth/image_raw", "sensor_msgs/msg/Image")
    assert first_of("left/depth/image_raw") == "camera/depth/image_raw"
    assert first_of("left/image_raw/compressed") == "camera/image_raw/compressed"
    assert learn("wide/image", "marine_acoustic_msgs/msg/RawSonarImage")
    assert first_of("wide/image") == "side_scan/image"
    assert learn("gps_2", "sensor_msgs/msg/NavSatFix")
    assert ros.decoder("gps_2") is ros.decoder("gps")
    assert not learn("other/thing", "sensor_msgs/msg/Image")
    assert not learn("cmd_mine", "geometry_msgs/msg/Twist"), "commands are no samples"


@pytest.mark.parametrize("kind", ["laser", "profiler", "forward_sonar", "scanning_sonar", "altimeter", "dvl"])
def test_the_kind_of_a_topic_follows_from_the_nodes_other_topics(kind: str) -> None:
    """LaserScan, Range and ProjectedSonarImage are types of several kinds, which decode them differently."""
    published = {topic: TOPICS[row].type for topic, row in further_topics("aft", kind).items()}
    for topic, type_name in published.items():
        if TOPICS[further_topics("aft", kind)[topic]].priority != "real_time":
            assert learn(topic, type_name, published)
            assert first_of(topic) == further_topics("aft", kind)[topic]


def test_a_second_leak_switch_has_its_own_topic() -> None:
    announce(read_sensors({"leak_aft": {"sensor": "leak"}}, ""), "")
    ((topic, payload),) = ros.encoder("leak_aft")(FlagSample(0, True), "")
    assert topic == "leak_aft"
    assert ros.decoder(topic)(payload) is True  # type: ignore[misc]
    assert ros_name("std_msgs::msg::dds_::Bool_") == TOPICS[topic].type
