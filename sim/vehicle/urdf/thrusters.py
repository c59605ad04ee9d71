"""Read the thrusters of a model: their poses from the joints, their limits from the plugins of simulators."""

from collections.abc import Mapping
from math import inf
from typing import Any

from hil.common.errors import ConfigError
from sim.vehicle.urdf.pose import Pose
from sim.vehicle.urdf.text import Element, attribute, child_text, number_of, numbers_of, plain, to_frd

_DENSITY, _DIAMETER, _COEFFICIENT = "1000", "0.02", "1"  # gz-sim's defaults of a thruster


def read_thrusters(robot: Element, poses: Mapping[str, Pose], path: str, notes: list[str]) -> list[dict[str, Any]]:
    """Return a thruster for each thruster plugin; without such plugins, for each turning joint of a link "thruster".

    Raises ConfigError for a plugin whose joint does not exist.
    """
    joints = {joint.get("name", ""): joint for joint in robot.findall("joint")}
    controls = {child_text(each, "jointName"): each for each in robot.iter("control")}
    thrusters = []
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
        thrusters.append(pose | limits)
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
        "name": plain(target(joint, "child").rsplit("/", 1)[-1].rsplit("::", 1)[-1]).removesuffix("_link"),
        "position": to_frd(pose.position),
        "direction": to_frd(pose.rotate(axis)),
    }


def _limits(plugin: Element, control: Element | None, path: str) -> dict[str, float]:
    """Return the given ones of limits (N), lag (s) and diameter (m) of uuv_simulator's or gz-sim's thruster."""
    if plugin.find("conversion") is not None:
        return _uuv_limits(plugin, path)
    max_thrust = child_text(plugin, "thrust_max", "max_thrust_cmd")
    min_thrust = child_text(plugin, "thrust_min", "min_thrust_cmd")
    lag, diameter = child_text(plugin, "dynamics/timeConstant"), child_text(plugin, "propeller_diameter")
    if control is not None and max_thrust is None and min_thrust is None:
        min_thrust, max_thrust = _of_autopilot(control, path)
    limits = {"max_forward": max_thrust, "max_reverse": min_thrust, "time_constant": lag, "diameter": diameter}
    values = {key: abs(number_of(text, path)) for key, text in limits.items() if text is not None}
    if (child_text(plugin, "use_angvel_cmd") or "").lower() in ("1", "true"):
        coefficient, density, size = (
            abs(number_of(child_text(plugin, key) or usual, path))
            for key, usual in (
                ("thrust_coefficient", _COEFFICIENT), ("fluid_density", _DENSITY), ("propeller_diameter", _DIAMETER),
            )
        )  # fmt: skip
        for key in values.keys() & {"max_forward", "max_reverse"}:
            values[key] = coefficient * density * size**4 * values[key] ** 2  # of a speed in rad/s
    return values


def _of_autopilot(control: Element, path: str) -> tuple[str | None, str | None]:
    """Return the least and the largest command that Gazebo's ArduPilot plugin sends to a joint."""
    multiplier = child_text(control, "multiplier")
    if multiplier is None:
        return None, None
    factor, offset = number_of(multiplier, path), number_of(child_text(control, "offset") or "0", path)
    ends = sorted((factor * offset, factor * (1.0 + offset)))
    return (repr(ends[0]), repr(ends[1])) if ends[0] < 0.0 < ends[1] else (None, None)


def _uuv_limits(plugin: Element, path: str) -> dict[str, float]:
    """Return the limits of uuv_simulator's thruster: its clamped commands converted to thrust, and limits of thrust."""
    texts = {key: child_text(plugin, key) for key in ("clampMin", "clampMax", "thrustMin", "thrustMax")}
    texts["thrustMin"] = texts["thrustMin"] or child_text(plugin, "thrust_min")
    texts["thrustMax"] = texts["thrustMax"] or child_text(plugin, "thrust_max")
    values = {key: number_of(text, path) for key, text in texts.items() if text is not None}
    for least, most in (("clampMin", "clampMax"), ("thrustMin", "thrustMax")):
        if values.get(least, -inf) >= values.get(most, inf):
            values.pop(least, None)
            values.pop(most, None)
    gain, efficiency = (number_of(child_text(plugin, key) or "1", path) for key in ("gain", "thrust_efficiency"))
    ahead, astern = _converted(plugin, gain * values.get("clampMin", -inf), gain * values.get("clampMax", inf), path)
    ends = {"max_forward": min(ahead, values.get("thrustMax", inf))}
    ends["max_reverse"] = min(-astern, -values.get("thrustMin", -inf))
    found = {key: efficiency * end for key, end in ends.items() if 0.0 < end < inf}
    lag = child_text(plugin, "dynamics/timeConstant")
    return found | ({"time_constant": abs(number_of(lag, path))} if lag is not None else {})


def _converted(plugin: Element, lowest: float, highest: float, path: str) -> tuple[float, float]:
    """Return the largest and the least thrust (N) for commands from `lowest` to `highest`."""
    kind = child_text(plugin, "conversion/type")

    def number(key: str) -> float:
        return number_of(child_text(plugin, f"conversion/{key}") or "0", path)

    if kind == "Basic" and (factor := number("rotorConstant")):
        return factor * highest * abs(highest), factor * lowest * abs(lowest)
    if kind == "Bessa":
        right, left = number("deltaR"), number("deltaL")
        ahead = number("rotorConstantR") * (highest * abs(highest) - right)
        return ahead, number("rotorConstantL") * (lowest * abs(lowest) - left)
    if kind == "LinearInterp":
        thrusts = [number_of(word, path) for word in (child_text(plugin, "conversion/outputValues") or "").split()]
        return (max(thrusts), min(thrusts)) if thrusts else (inf, -inf)
    return inf, -inf


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
