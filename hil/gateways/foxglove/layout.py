"""A layout for Foxglove in which all panels are of one vehicle: to import, for live data and recordings alike."""

import json
from typing import Any

from hil.ros.topics import FAN
from hil.scenario.config import Scenario
from sim.sensors.sensor_set import SensorSet, select_sensors

COLOURS = "#2563eb", "#ea580c", "#16a34a", "#9333ea", "#0891b2", "#ca8a04", "#db2777", "#64748b"
ORANGE, GREEN = COLOURS[1:3]
MESSAGES_OF_PLOTS = {  # title of the plot -> path in the message, and name of the curve
    "depth": (("odom.pose.pose.position.z", "z (up, m)"), ("altitude.range", "altitude (m)")),
    "speed": (("odom.twist.twist.linear.x", "surge (m/s)"), ("cmd_vel.linear.x", "commanded (m/s)")),
    "thrusts": tuple((f"joint_states.effort[{n}]", f"thrust {n + 1} (N)") for n in range(len(COLOURS))),
    "battery": (("battery.voltage", "voltage (V)"), ("battery.current", "current (A)")),
    "turn": (("odom.twist.twist.angular.z", "turn rate (rad/s)"), ("cmd_vel.angular.z", "commanded (rad/s)")),
}
POINTS = {"laser": ORANGE, "profiler": GREEN}
PICTURES = {"jpeg": "image_raw/compressed", "both": "image_raw/compressed", "raw": "image_raw"}  # of a camera


def layout(node: str, scenario: Scenario | None = None) -> str:
    """Return the layout of the vehicle called `node` as the JSON that Foxglove imports.

    It shows the sensors of the scenario, without one those that each vehicle has: no panel stays empty. Panels
    that command the vehicle are on a separate tab, as a recording takes no commands.
    """
    sensors = scenario.sensors if scenario else select_sensors()
    images = _images(sensors, scenario.ros.images if scenario else "jpeg")
    fourth = "battery" if "battery" in sensors else "turn"
    plots = ("depth", "speed", "thrusts", fourth)
    health = {"topicToRender": "/diagnostics"}
    panels: dict[str, Any] = {
        "3D!scene": _three_d(node, f"{scenario.ros.frame_prefix if scenario else ''}base_link", sensors),
        **{panel: _image(node, topic) for panel, topic in images.items()},
        "Tab!side": {"activeTabIdx": 0, "tabs": TABS},
        "Teleop!stick": _teleop(node),
        "CallService!arm": {"serviceName": f"/{node}/arm", "requestPayload": '{"data": true}', "layout": "vertical"},
        "Parameters!gains": {"title": "Parameters"},
        "DiagnosticSummary!vehicles": {"minLevel": 0, "hardwareIdFilter": "", **health},
        "DiagnosticStatusPanel!slave": {"selectedHardwareId": "", "selectedName": f"{node}: slave", **health},
        **{f"Plot!{name}": _plot(node, name) for name in plots},
    }
    scene = "3D!scene"
    left = _split("column", scene, _row([*images]), 65) if images else scene
    curves = _split("column", _row(["Plot!depth", "Plot!speed"]), _row(["Plot!thrusts", f"Plot!{fourth}"]))
    return json.dumps(
        {
            "configById": panels,
            "globalVariables": {},
            "userNodes": {},
            "playbackConfig": {"speed": 1},
            "layout": _split("row", left, _split("column", curves, "Tab!side", 55), 55),
        },
        indent=2,
    )


def _images(sensors: SensorSet, format_of_camera: str) -> dict[str, str]:
    """Return the panels of pictures, each with its topic."""
    kinds = {"camera": PICTURES[format_of_camera], "forward_sonar": FAN}
    return {
        f"Image!{name}": f"{name}/{kinds[each.sensor.topic]}"
        for name, each in sensors.items() if each.sensor.topic in kinds
    }  # fmt: skip


def _row(panels: list[str]) -> Any:
    """Return panels side by side, all as wide."""
    first, *others = panels
    return _split("row", first, _row(others), 100 // len(panels)) if others else first


def _split(direction: str, first: Any, second: Any, percent: int = 50) -> dict[str, Any]:
    return {"direction": direction, "first": first, "second": second, "splitPercentage": percent}


_STICK = _split("column", "Teleop!stick", "CallService!arm", 65)
TABS = [
    {"title": "health", "layout": _split("row", "DiagnosticSummary!vehicles", "DiagnosticStatusPanel!slave", 30)},
    {"title": "commands", "layout": _split("row", _STICK, "Parameters!gains")},
]


def _three_d(node: str, frame: str, sensors: SensorSet) -> dict[str, Any]:
    visible = {"visible": True}
    # Without a field Foxglove chooses one, and colours by it.
    points = {**visible, "pointSize": 4, "colorMode": "flat", "colorField": "intensity"}
    topics = {name: POINTS[each.sensor.topic] for name, each in sensors.items() if each.sensor.topic in POINTS}
    return {
        "followTf": frame,
        "followMode": "follow-position",
        "cameraState": {"distance": 12, "phi": 55, "thetaOffset": 45, "targetOffset": [0, 0, 0], "fovy": 45},
        "scene": {"backgroundColor": "#0b1622", "transforms": {"showLabel": False}},
        "transforms": {},
        "topics": {
            "/scene": visible, f"/{node}/odom": visible, f"/{node}/plan": visible,
            **{f"/{node}/{name}": {**points, "flatColor": colour} for name, colour in topics.items()},
        },
        "layers": {"grid": {"layerId": "foxglove.Grid", "visible": True, "size": 100, "divisions": 20}},
    }  # fmt: skip


def _image(node: str, topic: str) -> dict[str, Any]:
    title = topic.partition("/")[0].replace("_", " ")
    return {"foxglovePanelTitle": title, "imageMode": {"imageTopic": f"/{node}/{topic}"}}


def _plot(node: str, title: str) -> dict[str, Any]:
    paths = [
        {"value": f"/{node}/{path}", "label": label, "enabled": True, "timestampMethod": "receiveTime", "color": colour}
        for (path, label), colour in zip(MESSAGES_OF_PLOTS[title], COLOURS, strict=False)
    ]
    many = len(paths) > 2
    legend = {"showLegend": True, "legendDisplay": "left" if many else "top", "sidebarDimension": 100 if many else 66}
    window = {"isSynced": True, "followingViewWidth": 60}
    return {"foxglovePanelTitle": title, "paths": paths, **legend, **window}


def _teleop(node: str) -> dict[str, Any]:
    buttons = (
        ("up", "linear-x", 0.4),
        ("down", "linear-x", -0.4),
        ("left", "angular-z", 0.5),
        ("right", "angular-z", -0.5),
    )
    fields = {f"{name}Button": {"field": field, "value": value} for name, field, value in buttons}
    return {"topic": f"/{node}/cmd_vel", "publishRate": 20, **fields}
