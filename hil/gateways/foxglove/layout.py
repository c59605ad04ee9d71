"""A layout for Foxglove in which all panels are of one vehicle: to import, for live data and recordings alike."""

import json
import os
from typing import Any

from hil.ros.topics import FAN
from hil.scenario.config import Scenario
from sim.sensors.sensor_set import select_sensors

# As Foxglove exports it, without sensors; NODE, PREFIX (of frames) and FOURTH (battery or turn) stand for names.
TEMPLATE = os.path.join(os.path.dirname(__file__), "layout.json")
POINTS = {"laser": "#ea580c", "profiler": "#16a34a"}
PICTURES = {"jpeg": "image_raw/compressed", "both": "image_raw/compressed", "raw": "image_raw"}  # of a camera


def layout(node: str, scenario: Scenario | None = None) -> str:
    """Return the layout of the vehicle called `node` as the JSON that Foxglove imports.

    It shows the sensors of the scenario, without one those that each vehicle has: no panel stays empty. Panels
    that command the vehicle are on a separate tab, as a recording takes no commands.
    """
    sensors = scenario.sensors if scenario else select_sensors()
    fourth, unused = ("battery", "turn") if "battery" in sensors else ("turn", "battery")
    names = {"NODE": node, "PREFIX": scenario.ros.frame_prefix if scenario else "", "FOURTH": fourth}
    with open(TEMPLATE, encoding="utf-8") as file:
        text = file.read()
    for word, name in names.items():
        text = text.replace(word, json.dumps(name)[1:-1])
    made: dict[str, Any] = json.loads(text)
    panels = made["configById"]
    del panels[f"Plot!{unused}"]
    pictures = {"camera": PICTURES[scenario.ros.images if scenario else "jpeg"], "forward_sonar": FAN}
    images: list[str] = []
    for name, each in sensors.items():
        kind, topic = each.sensor.topic, f"/{node}/{name}"
        if kind in POINTS:  # without a field Foxglove chooses one, and colours by it
            look = {"visible": True, "pointSize": 4, "colorMode": "flat", "colorField": "intensity"}
            panels["3D!scene"]["topics"][topic] = {**look, "flatColor": POINTS[kind]}
        elif kind in pictures:
            images.append(f"Image!{name}")
            image = {"imageTopic": f"{topic}/{pictures[kind]}"}
            panels[images[-1]] = {"foxglovePanelTitle": name.replace("_", " "), "imageMode": image}
    if images:
        below = {"second": _row(images), "splitPercentage": 65}
        made["layout"]["first"] = {"direction": "column", "first": "3D!scene", **below}
    return json.dumps(made, indent=2)


def _row(panels: list[str]) -> Any:
    """Return panels side by side, all as wide."""
    first, *others = panels

    if not others:
        return first
    return {"direction": "row", "first": first, "second": _row(others), "splitPercentage": 100 // len(panels)}
