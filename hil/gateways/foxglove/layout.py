"""A layout for Foxglove in which all panels are of one vehicle: to import, for live data and recordings alike."""

import json
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim.sensors.suite import SensorSet

COLOURS = "#2563eb", "#ea580c", "#16a34a", "#9333ea", "#0891b2", "#ca8a04", "#db2777", "#64748b"
BLUE, ORANGE, GREEN = COLOURS[:3]
MESSAGES_OF_PLOTS = {  # title of the plot -> path in the message, and name of the curve
    "depth": (("odom.pose.pose.position.z", "z (up, m)"), ("altitude.range", "altitude (m)")),
    "speed": (("odom.twist.twist.linear.x", "surge (m/s)"), ("cmd_vel.linear.x", "commanded (m/s)")),
    "thrusts": tuple((f"joint_states.effort[{n}]", f"thrust {n + 1} (N)") for n in range(len(COLOURS))),
    "battery": (("battery.voltage", "voltage (V)"), ("battery.current", "current (A)")),
}


def layout(node: str, frame_prefix: str = "", sensors: "SensorSet" = MappingProxyType({})) -> str:
    """Return the layout of the vehicle called `node` as the JSON that Foxglove imports.

    It has a panel for each camera and forward-looking sonar of `sensors`, one of both without any.
    """
    images = _images(sensors)
    panels: dict[str, Any] = {
        "3D!scene": _three_d(node, f"{frame_prefix}base_link"),
        **{panel: _image(node, topic) for panel, topic in images.items()},
        "Teleop!stick": _teleop(node),
        "CallService!arm": {"serviceName": f"/{node}/arm", "requestPayload": '{"data": true}', "layout": "vertical"},
        "Parameters!gains": {"title": "Parameters"},
        "DiagnosticSummary!health": {"minLevel": 0, "topicToRender": "/diagnostics", "hardwareIdFilter": ""},
        **{f"Plot!{name}": _plot(node, name, curves) for name, curves in MESSAGES_OF_PLOTS.items()},
    }
    left = _split("column", "3D!scene", _row([*images]), 65)
    plots = _split("column", _split("row", "Plot!depth", "Plot!speed"), _split("row", "Plot!thrusts", "Plot!battery"))
    acts = _split("row", _split("column", "Teleop!stick", "CallService!arm", 65), "Parameters!gains")
    right = _split("column", plots, _split("row", acts, "DiagnosticSummary!health", 65), 55)
    return json.dumps(
        {
            "configById": panels,
            "globalVariables": {},
            "userNodes": {},
            "playbackConfig": {"speed": 1},
            "layout": _split("row", left, right, 55),
        },
        indent=2,
    )


def topics_of(node: str) -> set[str]:
    """Return the topics that the layout shows."""
    plotted = {path.partition(".")[0] for curves in MESSAGES_OF_PLOTS.values() for path, _ in curves}
    shown = {*plotted, "laser", "profiler", *_images({}).values()}
    return {f"/{node}/{name}" for name in shown}


def _images(sensors: "SensorSet") -> Mapping[str, str]:
    """Return the panels of pictures, each with its topic."""
    kinds = {"camera": "image_raw/compressed", "forward_sonar": "fan"}
    shown = {name: kinds[each.sensor.topic] for name, each in sensors.items() if each.sensor.topic in kinds}
    return {f"Image!{name}": f"{name}/{end}" for name, end in (shown or kinds).items()}


def _row(panels: list[str]) -> Any:
    """Return panels side by side, all as wide."""
    first, *others = panels
    return _split("row", first, _row(others), 100 // len(panels)) if others else first


def _split(direction: str, first: Any, second: Any, percent: int = 50) -> dict[str, Any]:
    return {"direction": direction, "first": first, "second": second, "splitPercentage": percent}


def _three_d(node: str, frame: str) -> dict[str, Any]:
    visible = {"visible": True}
    points = {**visible, "pointSize": 4, "colorMode": "flat"}
    return {
        "followTf": frame,
        "followMode": "follow-position",
        "cameraState": {"distance": 12, "phi": 55, "thetaOffset": 45, "targetOffset": [0, 0, 0], "fovy": 45},
        "scene": {"backgroundColor": "#0b1622", "transforms": {"showLabel": False}},
        "transforms": {},
        "topics": {
            "/scene": visible, f"/{node}/laser": {**points, "flatColor": ORANGE},
            f"/{node}/profiler": {**points, "flatColor": GREEN}, f"/{node}/odom": visible,
        },
        "layers": {"grid": {"layerId": "foxglove.Grid", "visible": True, "size": 100, "divisions": 20}},
    }  # fmt: skip


def _image(node: str, topic: str) -> dict[str, Any]:
    title = topic.partition("/")[0].replace("_", " ")
    return {"foxglovePanelTitle": title, "imageMode": {"imageTopic": f"/{node}/{topic}"}}


def _plot(node: str, title: str, curves: tuple[tuple[str, str], ...]) -> dict[str, Any]:
    paths = [
        {"value": f"/{node}/{path}", "label": label, "enabled": True, "timestampMethod": "receiveTime", "color": colour}
        for (path, label), colour in zip(curves, COLOURS, strict=False)
    ]
    legend = {"showLegend": True, "legendDisplay": "left", "sidebarDimension": 110}
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
