"""Readings of one vehicle for the page, in SI units and radians, positions NED; None if not known."""

from collections.abc import Mapping
from math import cos, isfinite, sin
from typing import Any

from hil.common.quantiles import quantile
from hil.ros.diagnostics import Diagnostics
from hil.ros.topics import first_of

Latest = Mapping[str, Any]
MAX_POINTS = 400  # of one scan
SCANS = ("laser", "profiler")


def motion(latest: Latest) -> dict[str, Any] | None:
    """Return where a vehicle is and how it moves: the ground truth, or else the odometry; None before the first."""
    shown = latest.get("ground_truth") or latest.get("odom")
    if shown is None:
        return None
    joints, own = latest.get("joint_states"), latest.get("odom")
    return {
        "position": shown.position, "attitude": shown.orientation, "nu": shown.nu,
        "navigation": own.position if own and own is not shown else None,
        "thrusts": [float(each) for each in joints.efforts] if joints else (),
    }  # fmt: skip


def panel(latest: Latest, figures: Diagnostics, delays: tuple[list[float], dict[str, float]]) -> dict[str, Any]:
    """Return what the panels show several times a second."""
    altitude, battery, joints = latest.get("altitude"), latest.get("battery"), latest.get("joint_states")
    values: dict[str, Any] = {
        "altitude": altitude.distance if altitude else None,
        "battery": (battery.voltage, battery.charge / (battery.capacity or 1.0), battery.current) if battery else None,
        "names": joints.names if joints else (), "pwm": figures.pwm_us or (), "armed": figures.armed,
        "commander": figures.commander or "", "factor": figures.real_time_factor, "contacts": figures.contacts,
    }  # fmt: skip
    all_ms, hops = delays
    if all_ms:
        ordered = sorted(all_ms)
        values["delay"] = {
            "median": quantile(ordered, 0.5), "p99": quantile(ordered, 0.99), "count": len(ordered),
            "newest": all_ms[-1], "hops": hops,
        }  # fmt: skip
    return values


def scans(latest: Latest) -> dict[str, list[tuple[float, float, float]]]:
    """Return the end points (m, FRD of the sensor) of the beams of laser scanners and profilers, by sensor."""
    return {topic: _points(scan, first_of(topic)) for topic, scan in latest.items() if first_of(topic) in SCANS}


def _points(scan: Any, kind: str) -> list[tuple[float, float, float]]:
    """Return the points of a level fan (angles to starboard), or of one across the vehicle (0 is straight down)."""
    step = max(1, len(scan.ranges) // MAX_POINTS)
    beams = [(r, scan.angle_min + scan.angle_increment * n) for n, r in enumerate(scan.ranges) if n % step == 0]
    beams = [(float(r), a) for r, a in beams if isfinite(r)]
    if kind == "laser":
        return [(r * cos(a), r * sin(a), 0.0) for r, a in beams]
    return [(0.0, r * sin(a), r * cos(a)) for r, a in beams]
