"""Read the sensors of a model as those of a scenario: `<sensor>` tags, and uuv_simulator's and dave's plugins.

A sensor's frame is x forward and z up in these files, x forward and z down in ours; a beam of ours goes along z, of
theirs along x. The first sensor of a kind has the kind's name in a scenario, further ones their own of the model.
"""

from collections.abc import Callable, Iterator, Mapping
from itertools import count
from math import pi, radians, sqrt
from re import ASCII, sub
from typing import Any

from sim.sdf.poses import own_pose
from sim.sensors.sensor_set import SENSORS
from sim.vehicle.urdf.pose import Pose, pose_at
from sim.vehicle.urdf.text import Element, child_text, number_of, plain, to_frd

Keys = dict[str, Any]
_DOWN = pose_at((0.0, 0.0, 0.0), (0.0, -pi / 2.0, 0.0))  # z of ours along x of theirs
_LONGEST_NAME = 40  # letters of a sensor's, which is a topic's
_PASCAL = 9810.0  # of a metre of water, for a barometer's heights
_MOST_RATE = {"gps": 25.0, "imu": 2000.0, "magnetometer": 1000.0, "pressure": 1000.0}  # Hz; 100 of all others
# Parts of the file names of plugins (uuv_simulator, dave) -> our sensor.
_PLUGINS = (
    ("subsea_pressure", "pressure"), ("ros_dvl", "dvl"), ("ros_imu", "imu"), ("ros_magnetometer", "magnetometer"),
    ("ros_gps", "gps"), ("pose_gt", ""), ("p3d", ""),
)  # fmt: skip
_UNKNOWN = ("rpt_plugin", "cpc_plugin", "usbl", "modem", "sonar_ros")


def read_sensors(robot: Element, poses: Mapping[str, Pose], path: str, notes: list[str]) -> dict[str, Keys]:
    """Return the keys of each sensor by its name in a scenario; `notes` takes what has no place there."""
    sensors: dict[str, Keys] = {}
    for what, name, pose, keys in (*_tagged(robot, poses, path), *_plugged(robot, poses, path)):
        if not name:
            notes.append(f"Left out: the sensor {plain(what)[:80]}, of a kind that there is not.")
        else:
            keys = {key: value for key, value in keys.items() if value != {}}
            most = _MOST_RATE.get(name, 100.0)
            keys["rate"] = min(keys["rate"], most) if keys.get("rate") else None
            keys = {key: value for key, value in (_mounting(pose) | keys).items() if value is not None}
            if name in sensors:
                own = _further_name(what, name, sensors)
                notes.append(f"The sensor {plain(what)[:80]} is [sensors.{own}], one more {name}.")
                name, keys = own, {"sensor": name} | keys
            sensors[name] = keys
    return sensors


def _further_name(what: str, kind: str, taken: Mapping[str, Keys]) -> str:
    """Return a name for one more sensor of a kind: its own where that is of no kind, else by number."""
    own = sub(r"\W", "_", what.partition(" (")[0].strip("'\""), flags=ASCII)[:_LONGEST_NAME]
    kinds = {*SENSORS, *taken}
    if own.isidentifier() and own not in kinds:
        return own
    return next(name for number in count(2) if (name := f"{kind}_{number}") not in kinds)


def _tagged(robot: Element, poses: Mapping[str, Pose], path: str) -> Iterator[tuple[str, str, Pose, Keys]]:
    """Yield each `<sensor>`: what it is, its name in a scenario ("" for none), its pose and its keys."""
    beams = {each.text for each in robot.iter() if each.tag.startswith("beam_link_name")}  # parts of a DVL
    for holder in robot.iter("gazebo"):
        if holder.get("reference") in beams:
            continue
        base = poses.get(holder.get("reference") or "")
        for sensor in holder.findall("sensor"):
            kind = _kind(sensor)
            what = f"{sensor.get('name', '')!r} ({kind})"
            if base is None:
                yield what, "", Pose(), {}
                continue
            name, is_beam, read = _KINDS.get(kind, ("", False, _nothing))
            keys = read(sensor, path)
            if name == "laser" and keys.get("beams", 2) < 2:  # one beam: it looks along x
                name, is_beam = "echosounder", True
                keys = {key: keys[key] for key in ("min_range", "max_range", "error") if key in keys}
            pose = base.then(own_pose(sensor, path))
            yield (
                what,
                name,
                pose.then(_DOWN) if is_beam else pose,
                {"rate": _number(sensor, path, "update_rate")} | keys,
            )


def _plugged(robot: Element, poses: Mapping[str, Pose], path: str) -> Iterator[tuple[str, str, Pose, Keys]]:
    """Yield each sensor that a plugin is, with its place by the link that it names."""
    for plugin in robot.iter("plugin"):
        file = plugin.get("filename", "").lower()
        link = child_text(plugin, "link_name", "linkName", "bodyName") or ""
        name = next((name for part, name in _PLUGINS if part in file), None)
        if name:
            keys = _PLUGGED.get(name, _nothing)(plugin, path)
            pose = poses.get(link, Pose())
            yield plugin.get("name", file), name, pose.then(_DOWN) if name == "dvl" else pose, keys
        elif any(part in file for part in _UNKNOWN) and name is None:
            yield plugin.get("name", file) or file, "", Pose(), {}


def _kind(sensor: Element) -> str:
    """Return the type of a sensor; of a custom one that of Gazebo's own namespace."""
    kind = sensor.get("type", "")
    if kind == "custom":
        return next((value for key, value in sensor.items() if key.rpartition("}")[2] == "type" and "}" in key), kind)
    return kind


def _mounting(pose: Pose) -> Keys:
    """Return place and orientation of a sensor in the body, FRD."""
    signs = (1.0, -1.0, -1.0)
    turned = [[a * b * x for b, x in zip(signs, row, strict=True)] for a, row in zip(signs, pose.rotation, strict=True)]
    angles = [round(angle, 9) + 0.0 for angle in Pose(turned).angles()]
    keys: Keys = {"position": [round(x, 9) + 0.0 for x in to_frd(pose.position)]}
    return keys | ({"orientation": angles} if any(angles) else {})


def _inner(element: Element, *names: str) -> Element | None:
    """Return the first element at any depth of one of these names, whatever its namespace."""
    return next((each for each in element.iter() if each.tag.rpartition("}")[2] in names), None)


def _number(element: Element | None, path: str, *tags: str) -> float | None:
    text = child_text(element, *tags) if element is not None else None
    return number_of(text, path) if text else None


def _error(element: Element | None, path: str, factor: float = 1.0) -> Keys:
    """Return the error model of the first `<noise>` in an element: `factor` turns its unit into ours.

    Gazebo's dynamic bias is kicked by its deviation per root of a second: it settles at that times sqrt(tau / 2).
    """
    noise = _inner(element, "noise") if element is not None else None
    if noise is None:
        return {}
    tau = _number(noise, path, "dynamic_bias_correlation_time")
    kick = _number(noise, path, "dynamic_bias_stddev")
    keys = {
        "offset": (_number(noise, path, "mean") or 0.0) * factor,
        "noise": abs(_number(noise, path, "stddev") or 0.0) * factor,
        "turn_on": abs(_number(noise, path, "bias_stddev") or 0.0) * factor,
    }
    if tau and kick:
        keys |= {"bias": abs(kick) * sqrt(0.5 * abs(tau)) * factor, "bias_time": abs(tau)}
    return {key: value for key, value in keys.items() if value}


def _nothing(sensor: Element, path: str) -> Keys:
    return {}


def _imu(sensor: Element, path: str) -> Keys:
    rates, forces = _inner(sensor, "angular_velocity"), _inner(sensor, "linear_acceleration")
    return {"angular_velocity": _error(rates, path), "acceleration": _error(forces, path)}


def _pressure(sensor: Element, path: str) -> Keys:
    return {"error": _error(_inner(sensor, "pressure"), path)}


def _barometer(sensor: Element, path: str) -> Keys:
    return {"error": _error(_inner(sensor, "vertical_position"), path, _PASCAL)}


def _magnetometer(sensor: Element, path: str) -> Keys:
    error = _error(_inner(sensor, "magnetometer"), path)
    return {"error_xy": error, "error_z": error}


def _gps(sensor: Element, path: str) -> Keys:
    place = _inner(sensor, "position_sensing", "gps", "navsat")
    return {axis: _error(_inner(place, axis), path) if place is not None else {} for axis in ("horizontal", "vertical")}


def _ranges(sensor: Element, path: str) -> Keys:
    limits = next((each for each in sensor.iter("range") if each.find("max") is not None), None)
    near, far = _number(limits, path, "min"), _number(limits, path, "max")
    keys: Keys = {
        "min_range": min(max(near, 0.0), 10.0) if near is not None else None,
        "max_range": min(max(far, 0.1), 1000.0) if far is not None else None,
    }
    return keys | {"error": _error(sensor, path)}


def _laser(sensor: Element, path: str) -> Keys:
    """Return the keys of a laser; SDF's angles grow to port, ours to starboard."""
    scan = _inner(sensor, "horizontal")
    samples, least, most = (_number(scan, path, key) for key in ("samples", "min_angle", "max_angle"))
    keys: Keys = {"beams": min(int(samples), 10_000)} if samples else {}
    if least is not None and most is not None and most > least and most - least <= 2.0 * pi + 1e-6:
        keys |= {"angle_min": max(-most, -pi), "angle_max": min(-least, pi)}
    return keys | _ranges(sensor, path)


def _camera(sensor: Element, path: str) -> Keys:
    camera = _inner(sensor, "camera")
    if camera is None:
        return {}
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
    near, far = (_number(sensor_part, path, key) for sensor_part, key in _dvl_limits(sensor))
    return {
        "tilt": min(max(tilt, 0.087), 1.05) if tilt is not None else None,
        "min_range": min(near, 10.0) if near is not None else None,
        "max_range": min(max(far, 0.1), 1000.0) if far is not None else None,
        "velocity": _error(tracking, path),
    }


def _dvl_limits(sensor: Element) -> list[tuple[Element | None, str]]:
    """Return the elements that hold the least and the largest range."""
    holders = {
        tag: next((each for each in sensor.iter() if any(c.tag.rpartition("}")[2] == tag for c in each)), None)
        for tag in ("minimum_range", "maximum_range")
    }
    return [(holders["minimum_range"], "minimum_range"), (holders["maximum_range"], "maximum_range")]


def _by_plugin(plugin: Element, path: str) -> Keys:
    return {"rate": _number(plugin, path, "update_rate", "updateRate")}


def _imu_plugin(plugin: Element, path: str) -> Keys:
    """Return the keys of uuv_simulator's IMU; its random walk settles at that times sqrt(tau / 2)."""
    keys = _by_plugin(plugin, path)
    for ours, theirs in (("angular_velocity", "gyroscope"), ("acceleration", "accelerometer")):
        density = _number(plugin, path, f"{theirs}_noise_density")
        walk = _number(plugin, path, f"{theirs}_bias_random_walk", f"{theirs}_random_walk")
        tau = _number(plugin, path, f"{theirs}_bias_correlation_time")
        turn_on = _number(plugin, path, f"{theirs}_turn_on_bias_sigma")
        error = {"noise_density": density, "turn_on": turn_on}
        if walk and tau:
            error |= {"bias": walk * sqrt(0.5 * tau), "bias_time": tau}
        keys[ours] = {key: value for key, value in error.items() if value}
    return keys


def _pressure_plugin(plugin: Element, path: str) -> Keys:
    noise = _number(plugin, path, "noise_sigma")
    return _by_plugin(plugin, path) | {"error": {"noise": 1000.0 * noise} if noise else {}}  # of kPa


# Type of a `<sensor>` -> our sensor, whether theirs looks along x where ours looks along z, and who reads it.
_KINDS: dict[str, tuple[str, bool, Callable[[Element, str], Keys]]] = {
    "imu": ("imu", False, _imu), "air_pressure": ("pressure", False, _pressure),
    "altimeter": ("pressure", False, _barometer), "magnetometer": ("magnetometer", False, _magnetometer),
    "navsat": ("gps", False, _gps), "gps": ("gps", False, _gps), "dvl": ("dvl", False, _dvl),
    "gpu_lidar": ("laser", False, _laser), "lidar": ("laser", False, _laser), "ray": ("laser", False, _laser),
    "gpu_ray": ("laser", False, _laser), "sonar": ("echosounder", True, _ranges), "camera": ("camera", False, _camera),
    "depth_camera": ("camera", False, _camera), "depth": ("camera", False, _camera),
    "rgbd_camera": ("camera", False, _camera), "rgbd": ("camera", False, _camera),
    "wideanglecamera": ("camera", False, _camera), "contact": ("contact", False, _nothing),
}  # fmt: skip
_PLUGGED: dict[str, Callable[[Element, str], Keys]] = {
    "imu": _imu_plugin, "pressure": _pressure_plugin, "dvl": _by_plugin, "magnetometer": _by_plugin, "gps": _by_plugin,
}  # fmt: skip
