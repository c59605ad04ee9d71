"""Read the sensors of a model as a scenario's tables: `<sensor>` tags, and the plugins of uuv_simulator and DAVE.

In these files a sensor's frame is x forward and z up, in ours x forward and z down; a beam is along x there, along z
here. In the scenario, the first sensor of a kind is named after its kind, and further ones as in the model.
"""

from collections.abc import Callable, Iterator, Mapping
from itertools import count
from math import pi, radians, sqrt
from re import ASCII, sub
from typing import Any

from sim.sensors.kinds import SENSORS
from sim.vehicle.urdf.pose import Pose, pose_at
from sim.vehicle.urdf.sdf_pose import own_pose
from sim.vehicle.urdf.text import Element, child_text, number_of, plain, to_frd

Keys = dict[str, Any]
_DOWN = pose_at((0.0, 0.0, 0.0), (0.0, -pi / 2.0, 0.0))  # turns our z axis into their x axis
_MAX_NAME = 40  # letters of a sensor's name, which becomes a topic
_PASCAL = 9810.0  # of a metre of water, for a barometer's heights
_MAX_RATE = {"gps": 25.0, "imu": 2000.0, "magnetometer": 1000.0, "pressure": 1000.0}  # Hz; 100 of all others
# Parts of the file names of plugins (uuv_simulator, DAVE) -> our sensor.
_PLUGINS = (
    ("subsea_pressure", "pressure"), ("ros_dvl", "dvl"), ("ros_imu", "imu"), ("ros_magnetometer", "magnetometer"),
    ("ros_gps", "gps"), ("pose_gt", ""), ("p3d", ""),
)  # fmt: skip
_UNKNOWN = ("rpt_plugin", "cpc_plugin", "usbl", "modem", "sonar_ros")


def read_sensors(robot: Element, poses: Mapping[str, Pose], path: str, notes: list[str]) -> dict[str, Keys]:
    """Return the keys of each sensor by its name in a scenario; `notes` gets what cannot be imported."""
    sensors: dict[str, Keys] = {}
    for label, name, pose, keys in (*_tag_sensors(robot, poses, path), *_plugin_sensors(robot, poses, path)):
        if not name:
            notes.append(f"Left out: the sensor {plain(label)[:80]}, of a kind that there is not.")
        else:
            keys = {key: value for key, value in keys.items() if value != {}}
            max_rate = _MAX_RATE.get(name, 100.0)
            keys["rate"] = min(keys["rate"], max_rate) if keys.get("rate") else None
            keys = {key: value for key, value in (_mounting(pose) | keys).items() if value is not None}
            if name in sensors:
                own = _unique_name(label, name, sensors)
                notes.append(f"The sensor {plain(label)[:80]} is [sensors.{own}], one more {name}.")
                name, keys = own, {"sensor": name} | keys
            sensors[name] = keys
    return sensors


def _unique_name(label: str, kind: str, used_names: Mapping[str, Keys]) -> str:
    """Return a name for one more sensor of a kind: its own if that is free and names no kind, else with a number."""
    own = sub(r"\W", "_", label.partition(" (")[0].strip("'\""), flags=ASCII)[:_MAX_NAME]
    kinds = {*SENSORS, *used_names}
    if own.isidentifier() and own not in kinds:
        return own
    return next(name for number in count(2) if (name := f"{kind}_{number}") not in kinds)


def _tag_sensors(robot: Element, poses: Mapping[str, Pose], path: str) -> Iterator[tuple[str, str, Pose, Keys]]:
    """Yield of each `<sensor>` its label for notes, name in a scenario ("" if it has none), pose and keys."""
    beams = {each.text for each in robot.iter() if each.tag.startswith("beam_link_name")}  # parts of a DVL
    for holder in robot.iter("gazebo"):
        if holder.get("reference") in beams:
            continue
        base = poses.get(holder.get("reference") or "")
        for sensor in holder.findall("sensor"):
            kind = _kind(sensor)
            label = f"{sensor.get('name', '')!r} ({kind})"
            if base is None:
                yield label, "", Pose(), {}
                continue
            name, is_beam, read = _KINDS.get(kind, ("", False, _no_keys))
            keys = read(sensor, path)
            if name == "laser" and keys.get("beams", 2) < 2:  # a single beam, along x
                name, is_beam = "echosounder", True
                keys = {key: keys[key] for key in ("min_range", "max_range", "error") if key in keys}
            pose = base.then(own_pose(sensor, path))
            yield (
                label,
                name,
                pose.then(_DOWN) if is_beam else pose,
                {"rate": _number(sensor, path, "update_rate")} | keys,
            )


def _plugin_sensors(robot: Element, poses: Mapping[str, Pose], path: str) -> Iterator[tuple[str, str, Pose, Keys]]:
    """Yield each sensor that is a plugin as `_tag_sensors` does; its pose is that of the link it names."""
    for plugin in robot.iter("plugin"):
        file = plugin.get("filename", "").lower()
        link = child_text(plugin, "link_name", "linkName", "bodyName") or ""
        name = next((name for part, name in _PLUGINS if part in file), None)
        if name:
            keys = _PLUGIN_READERS.get(name, _no_keys)(plugin, path)
            pose = poses.get(link, Pose())
            yield plugin.get("name", file), name, pose.then(_DOWN) if name == "dvl" else pose, keys
        elif any(part in file for part in _UNKNOWN) and name is None:
            yield plugin.get("name", file) or file, "", Pose(), {}


def _kind(sensor: Element) -> str:
    """Return the type of a sensor; for a custom one its type in Gazebo's own namespace."""
    kind = sensor.get("type", "")
    if kind == "custom":
        return next((value for key, value in sensor.items() if key.rpartition("}")[2] == "type" and "}" in key), kind)
    return kind


def _mounting(pose: Pose) -> Keys:
    """Return position and orientation of a sensor in the body axes (FRD)."""
    signs = (1.0, -1.0, -1.0)
    turned = [[a * b * x for b, x in zip(signs, row, strict=True)] for a, row in zip(signs, pose.rotation, strict=True)]
    angles = [round(angle, 9) + 0.0 for angle in Pose(turned).angles()]
    keys: Keys = {"position": [round(x, 9) + 0.0 for x in to_frd(pose.position)]}
    return keys | ({"orientation": angles} if any(angles) else {})


def _inner(element: Element, *names: str) -> Element | None:
    """Return the first element at any depth with one of these names, in any namespace."""
    return next((each for each in element.iter() if each.tag.rpartition("}")[2] in names), None)


def _number(element: Element | None, path: str, *tags: str) -> float | None:
    text = child_text(element, *tags) if element is not None else None
    return number_of(text, path) if text else None


def _error(element: Element | None, path: str, factor: float = 1.0) -> Keys:
    """Return the error model of the first `<noise>` in an element; `factor` converts its unit to ours.

    Gazebo's dynamic bias is a random walk with a deviation per root of a second: its stationary deviation is that times
    sqrt(tau / 2).
    """
    noise = _inner(element, "noise") if element is not None else None
    tau = _number(noise, path, "dynamic_bias_correlation_time")
    walk = _number(noise, path, "dynamic_bias_stddev")
    keys = {
        "offset": (_number(noise, path, "mean") or 0.0) * factor,
        "noise": abs(_number(noise, path, "stddev") or 0.0) * factor,
        "turn_on": abs(_number(noise, path, "bias_stddev") or 0.0) * factor,
    }
    if tau and walk:
        keys |= {"bias": abs(walk) * sqrt(0.5 * abs(tau)) * factor, "bias_time": abs(tau)}
    return {key: value for key, value in keys.items() if value}


def _no_keys(sensor: Element, path: str) -> Keys:
    return {}


def _errors(tags: Mapping[str, str], factor: float = 1.0) -> Callable[[Element, str], Keys]:
    """Return a reader of the error models under these tags; `factor` converts their unit to ours."""
    return lambda sensor, path: {key: _error(_inner(sensor, tag), path, factor) for key, tag in tags.items()}


def _gps(sensor: Element, path: str) -> Keys:
    part = _inner(sensor, "position_sensing", "gps", "navsat")
    return {axis: _error(_inner(part, axis), path) if part is not None else {} for axis in ("horizontal", "vertical")}


def _ranges(sensor: Element, path: str) -> Keys:
    limits = next((each for each in sensor.iter("range") if each.find("max") is not None), None)
    near, far = _number(limits, path, "min"), _number(limits, path, "max")
    keys: Keys = {
        "min_range": min(max(near, 0.0), 10.0) if near is not None else None,
        "max_range": min(max(far, 0.1), 1000.0) if far is not None else None,
    }
    return keys | {"error": _error(sensor, path)}


def _laser(sensor: Element, path: str) -> Keys:
    """Return the keys of a laser. SDF's angles are positive to port, ours to starboard."""
    scan = _inner(sensor, "horizontal")
    samples, least, most = (_number(scan, path, key) for key in ("samples", "min_angle", "max_angle"))
    keys: Keys = {"beams": min(int(samples), 10_000)} if samples else {}
    if least is not None and most is not None and most > least and most - least <= 2.0 * pi + 1e-6:
        keys |= {"angle_min": max(-most, -pi), "angle_max": min(-least, pi)}
    return keys | _ranges(sensor, path)


def _camera(sensor: Element, path: str) -> Keys:
    camera = _inner(sensor, "camera")
    field, far = _number(camera, path, "horizontal_fov"), _number(camera, path, "clip/far")
    sizes = {key: _number(camera, path, f"image/{key}") for key in ("width", "height")}
    keys: Keys = {key: min(max(int(size), 1), 4096) for key, size in sizes.items() if size}
    coefficients = [_number(camera, path, f"distortion/{key}") for key in ("k1", "k2", "p1", "p2", "k3")]
    if any(coefficients):
        keys["distortion"] = [value or 0.0 for value in coefficients]
    keys["field_of_view"] = min(field, 0.95 * pi) if field else None
    keys["max_range"] = min(max(far, 0.1), 1000.0) if far else None
    keys["depth"] = "depth" in sensor.get("type", "") or "rgbd" in sensor.get("type", "") or None
    return keys


def _dvl(sensor: Element, path: str) -> Keys:
    arrangement, tracking = _inner(sensor, "arrangement"), _inner(sensor, "bottom_mode")
    tilt = _number(_inner(sensor, "beam"), path, "tilt")
    if tilt is not None and arrangement is not None and (arrangement.get("degrees") or "").lower() in ("1", "true"):
        tilt = radians(tilt)
    near, far = (_number(_holder(sensor, tag), path, tag) for tag in ("minimum_range", "maximum_range"))
    return {
        "tilt": min(max(tilt, 0.087), 1.05) if tilt is not None else None,
        "min_range": min(near, 10.0) if near is not None else None,
        "max_range": min(max(far, 0.1), 1000.0) if far is not None else None,
        "velocity": _error(tracking, path),
    }


def _holder(sensor: Element, tag: str) -> Element | None:
    """Return the first element that has a child `tag`."""
    return next((each for each in sensor.iter() if each.find(tag) is not None), None)


def _by_plugin(plugin: Element, path: str) -> Keys:
    return {"rate": _number(plugin, path, "update_rate", "updateRate")}


def _imu_plugin(plugin: Element, path: str) -> Keys:
    """Return the keys of uuv_simulator's IMU. Its random walk settles at a deviation of sqrt(tau / 2) times that."""
    keys = _by_plugin(plugin, path)
    for quantity, urdf_name in (("angular_velocity", "gyroscope"), ("acceleration", "accelerometer")):
        density = _number(plugin, path, f"{urdf_name}_noise_density")
        walk = _number(plugin, path, f"{urdf_name}_bias_random_walk", f"{urdf_name}_random_walk")
        tau = _number(plugin, path, f"{urdf_name}_bias_correlation_time")
        turn_on = _number(plugin, path, f"{urdf_name}_turn_on_bias_sigma")
        error = {"noise_density": density, "turn_on": turn_on}
        if walk and tau:
            error |= {"bias": walk * sqrt(0.5 * tau), "bias_time": tau}
        keys[quantity] = {key: value for key, value in error.items() if value}
    return keys


def _pressure_plugin(plugin: Element, path: str) -> Keys:
    noise = _number(plugin, path, "noise_sigma")
    return _by_plugin(plugin, path) | {"error": {"noise": 1000.0 * noise} if noise else {}}  # from kPa


# Type of a `<sensor>` -> our sensor, whether its beam is along x there and along z here, and the reading function.
_KINDS: dict[str, tuple[str, bool, Callable[[Element, str], Keys]]] = {
    "imu": ("imu", False, _errors({"angular_velocity": "angular_velocity", "acceleration": "linear_acceleration"})),
    "air_pressure": ("pressure", False, _errors({"error": "pressure"})),
    "altimeter": ("pressure", False, _errors({"error": "vertical_position"}, _PASCAL)),
    "magnetometer": ("magnetometer", False, _errors({"error_xy": "magnetometer", "error_z": "magnetometer"})),
    "navsat": ("gps", False, _gps), "gps": ("gps", False, _gps), "dvl": ("dvl", False, _dvl),
    "gpu_lidar": ("laser", False, _laser), "lidar": ("laser", False, _laser), "ray": ("laser", False, _laser),
    "gpu_ray": ("laser", False, _laser), "sonar": ("echosounder", True, _ranges), "camera": ("camera", False, _camera),
    "depth_camera": ("camera", False, _camera), "depth": ("camera", False, _camera),
    "rgbd_camera": ("camera", False, _camera), "rgbd": ("camera", False, _camera),
    "wideanglecamera": ("camera", False, _camera), "contact": ("contact", False, _no_keys),
}  # fmt: skip
_PLUGIN_READERS: dict[str, Callable[[Element, str], Keys]] = {
    "imu": _imu_plugin, "pressure": _pressure_plugin, "dvl": _by_plugin, "magnetometer": _by_plugin, "gps": _by_plugin,
}  # fmt: skip
