"""Read the thrusters of a model: their poses from the joints, their limits from the plugins of simulators."""

from collections.abc import Mapping
from math import inf
from typing import Any

from hil.common.errors import ConfigError
from sim.interpolation import interpolate
from sim.vehicle.urdf.pose import Pose
from sim.vehicle.urdf.text import Element, attribute, child_text, number_of, numbers_of, to_frd, unscoped

_DENSITY, _DIAMETER, _COEFFICIENT = "1000", "0.02", "1"  # gz-sim's defaults of a thruster
_DEAD_BANDS = ("deadband", "conversion/deltaL", "conversion/deltaR")  # tags of gz-sim (N) and uuv_simulator (of speed²)


def read_thrusters(robot: Element, poses: Mapping[str, Pose], path: str, notes: list[str]) -> list[dict[str, Any]]:
    """Return a thruster for each thruster plugin; without such plugins, for each turning joint of a link "thruster".

    Where a negative gain or constant turns the thrust of a positive command around, the direction is turned around.
    Raises ConfigError for a plugin whose joint does not exist.
    """
    joints = {joint.get("name", ""): joint for joint in robot.findall("joint")}
    controls = {child_text(each, "jointName"): each for each in robot.iter("control")}
    thrusters: list[dict[str, Any]] = []
    without_band: list[str] = []
    for plugin in robot.iter("plugin"):
        name, file = child_text(plugin, "jointName", "joint_name"), plugin.get("filename", "").lower()
        link = child_text(plugin, "linkName", "link_name")
        is_motor = "motormodel" in file or "motor_model" in file
        if name is None and "thruster" in file and link is not None:
            name = next((each for each, joint in joints.items() if target(joint, "child") == link), None)
        if not ("thruster" in file or is_motor) or not name:
            continue
        if name not in joints:
            raise ConfigError(f"{path}: a thruster plugin names the joint {name!r}, which is not there")
        pose = _pose(joints[name], poses, path)
        if is_motor:  # its thrust is along the link's z axis, for any axis of the joint
            pose["direction"] = to_frd(poses[target(joints[name], "child")].rotate((0.0, 0.0, 1.0)))
        limits = _motor_limits(plugin, path) if is_motor else _limits(plugin, controls.get(name), path)
        if limits.pop("sign", 1.0) < 0.0:
            pose["direction"] = [0.0 - x for x in pose["direction"]]
        thrusters.append(pose | limits)
        if any(number_of(plugin.findtext(tag) or "0", path) for tag in _DEAD_BANDS):
            without_band.append(pose["name"])
    if without_band:
        notes.append(f"Left out: the dead band of {', '.join(without_band)}; dead_band_us gives one in pulse widths.")
    if not thrusters:
        turning = [joint for joint in joints.values() if joint.get("type") in ("continuous", "revolute")]
        named = [joint for joint in turning if "thruster" in target(joint, "child")]
        named = [joint for joint in named if joint.get("type") == "continuous" or "limit" not in [c.tag for c in joint]]
        thrusters = [_pose(joint, poses, path) for joint in named]
        notes += ["No thruster plugin: every turning joint of a link named thruster is one."] if thrusters else []
    return thrusters


def target(joint: Element, side: str) -> str:
    """Return the link at one side of a joint, "parent" or "child"."""
    return attribute(joint, side, "link")


def _pose(joint: Element, poses: Mapping[str, Pose], path: str) -> dict[str, Any]:
    pose = poses.get(target(joint, "child"))
    if pose is None:
        raise ConfigError(f"{path}: the link {target(joint, 'child')!r} of a thruster is not there")
    axis = numbers_of(attribute(joint, "axis", "xyz", "1 0 0"), path, 3)
    return {
        "name": unscoped(target(joint, "child")).removesuffix("_link"),
        "position": to_frd(pose.position),
        "direction": to_frd(pose.rotate(axis)),
    }


def _limits(plugin: Element, control: Element | None, path: str) -> dict[str, float]:
    """Return the given ones of limits (N), lag (s) and diameter (m) of uuv_simulator's or gz-sim's thruster.

    `sign` is negative if a positive command pushes against the joint's axis.
    """
    if plugin.find("conversion") is not None:
        return _uuv_limits(plugin, path)
    max_thrust = child_text(plugin, "thrust_max", "max_thrust_cmd")
    min_thrust = child_text(plugin, "thrust_min", "min_thrust_cmd")
    lag, diameter = child_text(plugin, "dynamics/timeConstant"), child_text(plugin, "propeller_diameter")
    sign = 1.0
    if control is not None:
        sign = number_of(child_text(control, "multiplier") or "1", path)
        if max_thrust is None and min_thrust is None:
            min_thrust, max_thrust = _of_autopilot(control, path)
        elif sign < 0.0:
            min_thrust, max_thrust = max_thrust, min_thrust
    texts = {"max_forward": max_thrust, "max_reverse": min_thrust, "time_constant": lag, "diameter": diameter}
    values = {key: abs(number_of(text, path)) for key, text in texts.items() if text is not None}
    if (child_text(plugin, "use_angvel_cmd") or "").lower() in ("1", "true"):
        coefficient, density, size = (
            number_of(child_text(plugin, key) or usual, path)
            for key, usual in (
                ("thrust_coefficient", _COEFFICIENT), ("fluid_density", _DENSITY), ("propeller_diameter", _DIAMETER),
            )
        )  # fmt: skip
        for key in values.keys() & {"max_forward", "max_reverse"}:
            values[key] = abs(coefficient * density) * size**4 * values[key] ** 2  # of a speed in rad/s
        sign *= coefficient
    return values | {"sign": sign}


def _of_autopilot(control: Element, path: str) -> tuple[str | None, str | None]:
    """Return the commands of Gazebo's ArduPilot plugin to a joint for the shortest and for the longest pulse."""
    multiplier = child_text(control, "multiplier")
    if multiplier is None:
        return None, None
    factor, offset = number_of(multiplier, path), number_of(child_text(control, "offset") or "0", path)
    ends = factor * offset, factor * (1.0 + offset)
    return (repr(ends[0]), repr(ends[1])) if ends[0] * ends[1] < 0.0 else (None, None)


def _uuv_limits(plugin: Element, path: str) -> dict[str, float]:
    """Return the limits of uuv_simulator's thruster: its clamped commands converted to thrust, and limits of thrust."""
    gain, efficiency = (number_of(child_text(plugin, key) or "1", path) for key in ("gain", "thrust_efficiency"))
    low, high = _range(plugin, ("thrustMin", "thrust_min"), ("thrustMax", "thrust_max"), path)
    astern, ahead = (_thrust(plugin, gain * end, path) for end in _range(plugin, ("clampMin",), ("clampMax",), path))
    sign = -1.0 if ahead < astern else 1.0
    if sign < 0.0:
        ahead, astern, high, low = -ahead, -astern, -low, -high
    ends = {"max_forward": min(ahead, high), "max_reverse": min(-astern, -low)}
    found = {key: efficiency * end for key, end in ends.items() if 0.0 < end < inf} | {"sign": sign}
    lag = child_text(plugin, "dynamics/timeConstant")
    return found | ({"time_constant": abs(number_of(lag, path))} if lag is not None else {})


def _range(plugin: Element, least: tuple[str, ...], most: tuple[str, ...], path: str) -> tuple[float, float]:
    """Return the numbers of the first tags that are there; no limits if they are in the wrong order."""
    low, high = (
        number_of(text, path) if (text := child_text(plugin, *tags)) is not None else end
        for tags, end in ((least, -inf), (most, inf))
    )
    return (low, high) if low < high else (-inf, inf)


def _thrust(plugin: Element, speed: float, path: str) -> float:
    """Return the thrust (N) of uuv_simulator's propeller at a speed, which may be infinite."""
    kind, square = child_text(plugin, "conversion/type"), speed * abs(speed)

    def number(key: str) -> float:
        return number_of(child_text(plugin, f"conversion/{key}") or "0", path)

    if kind == "Basic" and (factor := number("rotorConstant")):
        return factor * square
    if kind == "Bessa":
        side = "R" if speed > 0.0 else "L"
        return number(f"rotorConstant{side}") * (square - number(f"delta{side}"))
    if kind == "LinearInterp":
        inputs, thrusts = (
            [number_of(word, path) for word in (child_text(plugin, f"conversion/{key}Values") or "").split()]
            for key in ("input", "output")
        )
        if points := dict(sorted(zip(inputs, thrusts, strict=False))):
            return interpolate(list(points), list(points.values()), speed)
    return speed


def _motor_limits(plugin: Element, path: str) -> dict[str, float]:
    """Return the thrusts of a motor of PX4's models: a polynomial of the duty cycle, or its constant times speed²."""
    values = {}
    for key, tag in (("max_forward", "positiveThrustPolynomial"), ("max_reverse", "negativeThrustPolynomial")):
        text = child_text(plugin, tag)
        if text is not None:
            words = text.strip("[]").replace(",", " ").split()
            values[key] = abs(sum(number_of(word, path) for word in words))  # at a duty cycle of 1
    constant, speed = child_text(plugin, "motorConstant"), child_text(plugin, "maxRotVelocity")
    if not values and constant is not None and speed is not None:
        values["max_forward"] = abs(number_of(constant, path)) * number_of(speed, path) ** 2
    lag = child_text(plugin, "timeConstantUp")
    return values | ({"time_constant": abs(number_of(lag, path))} if lag is not None else {})
