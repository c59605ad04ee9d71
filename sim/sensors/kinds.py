"""The sensors that are built in: a row each, with class, topics and meaning.

A new sensor is a row here and a module with its class. Its messages need no other code if one of `hil.ros.sensors` has
their type and its samples; otherwise `codec` names the module of `hil.ros` that encodes and decodes them.
"""

from typing import Literal, NamedTuple

Priority = Literal["data", "background"]


class Stream(NamedTuple):
    """A topic: type of its ROS 2 messages, nominal rate (Hz), and what they contain."""

    topic: str
    message: str
    rate_hz: float
    meaning: str
    priority: Priority = "data"


class Kind(NamedTuple):
    """A kind of sensor: `place` of its class, "module:Class", imported when a vehicle carries it, and its topics.

    `topic` is that of its samples, unless it makes pictures; `more` are its other topics.
    """

    place: str
    topic: str
    message: str
    rate_hz: float
    meaning: str
    codec: str = "sensors"
    priority: Priority = "data"
    more: tuple[Stream, ...] = ()

    @property
    def streams(self) -> tuple[Stream, ...]:
        """All topics."""
        return (Stream(self.topic, self.message, self.rate_hz, self.meaning, self.priority), *self.more)


SENSORS = {  # by the name of the sensor's section in a scenario
    "imu": Kind("sim.sensors.imu:Imu", "imu", "sensor_msgs/msg/Imu", 100,
        "angular rates (rad/s) and specific force (m/s²)", "encoders"),
    "dvl": Kind("sim.sensors.ranging.dvl:Dvl", "dvl", "marine_acoustic_msgs/msg/Dvl", 8,
        "velocity (m/s) over the seabed, and each beam", "dvl", more=(
        Stream("dvl_twist", "geometry_msgs/msg/TwistWithCovarianceStamped", 8,
            "the velocity of `dvl` with its covariance, for navigation filters"),
        Stream("altitude", "sensor_msgs/msg/Range", 8,
            "distance (m) to the seabed by the DVL; inf without bottom lock"),
    )),
    "pressure": Kind("sim.sensors.pressure:Pressure", "pressure", "sensor_msgs/msg/FluidPressure", 20,
        "absolute pressure (Pa)", "encoders"),
    "odometry": Kind("sim.sensors.odometry:Odometry", "odom", "nav_msgs/msg/Odometry", 20,
        "the navigation's estimate: position and attitude in `odom`, velocity of the body", "encoders"),
    "ground_truth": Kind("sim.sensors.odometry:GroundTruth", "ground_truth", "nav_msgs/msg/Odometry", 20,
        "true position, attitude and velocity", "encoders"),
    "ahrs": Kind("sim.sensors.ahrs:Ahrs", "ahrs", "sensor_msgs/msg/Imu", 100,
        "attitude by the sensor's own filter, with rates and specific force"),
    "altimeter": Kind("sim.sensors.ranging.altimeter:Altimeter", "altimeter", "sensor_msgs/msg/Range", 10,
        "distance (m) along a narrow sonar beam"),
    "battery": Kind("sim.sensors.battery:BatteryMonitor", "battery", "sensor_msgs/msg/BatteryState", 1,
        "voltage (V), current (A, negative while it discharges), charge"),
    "contact": Kind("sim.sensors.contact:ContactSwitch", "contact", "std_msgs/msg/Bool", 20,
        "true while the hull touches the seabed or an obstacle"),
    "current_meter": Kind("sim.sensors.current_meter:CurrentMeter", "current_meter", "geometry_msgs/msg/TwistStamped",
        4, "velocity (m/s) of the water at the sensor, along the axes of the body"),
    "dvl_water": Kind("sim.sensors.ranging.dvl_water:DvlWater", "dvl_water", "marine_acoustic_msgs/msg/Dvl", 8,
        "velocity (m/s) relative to a layer of water, and each beam", "dvl"),
    "gps": Kind("sim.sensors.gps:Gps", "gps", "sensor_msgs/msg/NavSatFix", 1,
        "latitude, longitude (deg), altitude (m); no fix under water"),
    "leak": Kind("sim.sensors.leak:Leak", "leak", "std_msgs/msg/Bool", 1, "true if there is water in the hull"),
    "magnetometer": Kind("sim.sensors.magnetometer:Magnetometer", "magnetometer", "sensor_msgs/msg/MagneticField", 50,
        "magnetic field (T) along the axes of the body"),
    "usbl": Kind("sim.sensors.usbl:Usbl", "usbl", "geometry_msgs/msg/PoseWithCovarianceStamped", 1,
        "position (m) that the acoustic station measures, with its covariance"),
    "laser": Kind("sim.sensors.ranging.laser:Laser", "laser", "sensor_msgs/msg/LaserScan", 10,
        "distances (m) of a horizontal fan of beams (about z)", "scans"),
    "profiler": Kind("sim.sensors.ranging.profiler:Profiler", "profiler", "sensor_msgs/msg/LaserScan", 5,
        "distances (m) of a fan of beams across the track (about x), down to the seabed", "scans", more=(
        Stream("profiler/points", "sensor_msgs/msg/PointCloud2", 5, "the same as points (m), with strengths (dB)"),
    )),
    "scanning_sonar": Kind("sim.sensors.imaging.scanning_sonar:ScanningSonar", "scanning_sonar",
        "sensor_msgs/msg/LaserScan", 11,
        "distance (m) of the first echo of a ping, with the angle of the head", "scans", more=(
        Stream("scanning_sonar/image", "marine_acoustic_msgs/msg/ProjectedSonarImage", 11,
            "intensities of a ping by range; only if the sensor has the key `bins`", "background"),
    )),
    "echosounder": Kind("sim.sensors.ranging.echosounder:Echosounder", "echosounder", "sensor_msgs/msg/Range", 10,
        "distance (m) to the first echo below", "scans"),
    "camera": Kind("sim.sensors.imaging.camera.sensor:Camera", "camera/image_raw", "sensor_msgs/msg/Image", 5,
        "picture, `rgb8`", "images", "background", more=(
        Stream("camera/image_raw/compressed", "sensor_msgs/msg/CompressedImage", 5, "picture, JPEG", "background"),
        Stream("camera/camera_info", "sensor_msgs/msg/CameraInfo", 5,
            "focal lengths, principal point and distortion of the lens", "background"),
        Stream("camera/depth/image_raw", "sensor_msgs/msg/Image", 5,
            "distance (m) along the optical axis of each pixel", "background"),
        Stream("camera/depth/camera_info", "sensor_msgs/msg/CameraInfo", 5,
            "the same for the depth picture", "background"),
        Stream("camera/depth/points", "sensor_msgs/msg/PointCloud2", 5,
            "the depth picture as points (m)", "background"),
        Stream("camera/labels", "sensor_msgs/msg/Image", 5,
            "number of the object in each pixel; only if the camera has `ground_truth`", "background"),
    )),
    "forward_sonar": Kind("sim.sensors.imaging.forward_sonar:ForwardSonar", "forward_sonar/image",
        "marine_acoustic_msgs/msg/ProjectedSonarImage", 5,
        "intensities, one row for each range bin, one column for each beam", "images", "background", more=(
        Stream("forward_sonar/fan/image_raw", "sensor_msgs/msg/Image", 5,
            "the same drawn as a fan; ahead is up", "background"),
    )),
    "side_scan": Kind("sim.sensors.imaging.side_scan:SideScan", "side_scan/image",
        "marine_acoustic_msgs/msg/RawSonarImage", 5,
        "intensities of a ping by range, to port and to starboard", "images", "background"),
}  # fmt: skip
