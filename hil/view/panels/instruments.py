"""Instruments of one vehicle as SVG: artificial horizon, compass, depth, speed, pulse width and thrust per motor."""

from collections.abc import Sequence
from html import escape
from math import cos, degrees, isfinite, sin
from typing import Any, NamedTuple

from hil.view.scene import colours

WIDTH, SCROLLBAR = 320, 8
PWM_RANGE = 400.0  # us from neutral to the end of a bar
BAR_X, BAR_WIDTH = 130, 80
LONGEST_NAME = 20  # letters beside a bar
STYLE = "font-family:system-ui,sans-serif;font-size:12px;fill:currentColor"


class Reading(NamedTuple):
    """Values of the instruments in SI units and radians; nan if not known. `position` is NED."""

    roll: float
    pitch: float
    heading: float
    depth: float
    altitude: float
    speed: float
    position: Sequence[float]
    voltage: float
    pwm_us: Sequence[int]
    thrusts: Sequence[float]
    names: Sequence[str]


def reading(latest: Any, pwm_us: Sequence[int], names: Sequence[str]) -> Reading | None:
    """Return the readings of the newest samples (`latest` by topic); None before the first odometry."""
    from hil.client.samples import State

    sample = latest.get("odom") or latest.get("ground_truth")
    if sample is None:
        return None
    state = State(*sample)
    joints, battery, altitude = latest.get("joint_states"), latest.get("battery"), latest.get("altitude")
    return Reading(
        state.roll, state.pitch, state.heading, state.depth, altitude.distance if altitude else float("nan"),
        state.speed, state.position, battery.voltage if battery else float("nan"), pwm_us,
        joints.efforts if joints else (), joints.names if joints else names,
    )  # fmt: skip


def draw(now: Reading) -> str:
    """Return an SVG image of the instruments."""
    height = 250 + 20 * max(len(now.pwm_us), len(now.thrusts))
    size = f'viewBox="0 0 {WIDTH + SCROLLBAR} {height}" width="100%"'
    return (
        f'<svg {size} style="{STYLE}" role="img" aria-label="instruments">'
        f"{_horizon(now)}{_compass(now)}{_values(now)}{_motors(now)}</svg>"
    )


def _horizon(now: Reading) -> str:
    shift = max(-60.0, min(60.0, degrees(now.pitch) * 1.5))
    return (
        '<clipPath id="h"><circle cx="75" cy="75" r="65"/></clipPath>'
        f'<g clip-path="url(#h)"><g transform="rotate({-degrees(now.roll):.1f} 75 75) translate(0 {shift:.1f})">'
        '<rect x="-75" y="-125" width="300" height="200" fill="#7db8e8"/>'
        '<rect x="-75" y="75" width="300" height="200" fill="#8a6b4a"/>'
        '<line x1="-75" x2="225" y1="75" y2="75" stroke="white" stroke-width="2"/></g></g>'
        '<path d="M35 75h25l15 12 15-12h25" fill="none" stroke="#111" stroke-width="3"/>'
        '<circle cx="75" cy="75" r="65" fill="none" stroke="currentColor"/>'
        f'<text x="75" y="158" text-anchor="middle">roll {_degrees(now.roll)}, pitch {_degrees(now.pitch)}</text>'
    )


def _compass(now: Reading) -> str:
    marks = "".join(
        f'<text x="{225 + 52 * sin(angle):.1f}" y="{79 - 52 * cos(angle):.1f}" text-anchor="middle">{name}</text>'
        for name, angle in (("N", 0.0), ("E", 1.5708), ("S", 3.1416), ("W", 4.7124))
    )
    return (
        f'<circle cx="225" cy="75" r="65" fill="none" stroke="currentColor"/>{marks}'
        f'<g transform="rotate({degrees(now.heading):.1f} 225 75)">'
        f'<path d="M225 30l9 45h-18z" fill="{colours.css(colours.THRUST)}"/>'
        '<path d="M225 120l9-45h-18z" fill="#94a3b8"/></g>'
        f'<text x="225" y="158" text-anchor="middle">heading {degrees(now.heading) % 360.0:.0f}°</text>'
    )


def _values(now: Reading) -> str:
    north, east = now.position[:2]
    cells = (
        ("depth", now.depth, "{:.2f} m"), ("altitude", now.altitude, "{:.2f} m"), ("speed", now.speed, "{:.2f} m/s"),
        ("north", north, _metres(north)), ("east", east, _metres(east)), ("battery", now.voltage, "{:.1f} V"),
    )  # fmt: skip
    drawn = []
    for number, (name, value, form) in enumerate(cells):
        x, y = 8 + 104 * (number % 3), 182 + 28 * (number // 3)
        shown = form.format(value) if isfinite(value) else "-"
        drawn.append(f'<text x="{x}" y="{y}">{name} <tspan font-weight="bold">{shown}</tspan></text>')
    return "".join(drawn)


def _motors(now: Reading) -> str:
    rows = []
    for number in range(max(len(now.pwm_us), len(now.thrusts))):
        y = 236 + 20 * number
        pulse = now.pwm_us[number] if number < len(now.pwm_us) else 1500
        thrust = f"{now.thrusts[number]:+.1f} N" if number < len(now.thrusts) else ""
        name = escape(now.names[number]) if number < len(now.names) else f"channel {number + 1}"
        offset = max(-1.0, min(1.0, (pulse - 1500) / PWM_RANGE)) * BAR_WIDTH / 2
        left = BAR_X + BAR_WIDTH / 2 + min(offset, 0.0)
        rows.append(
            f'<text x="8" y="{y}" font-size="11">{name[:LONGEST_NAME]}</text>'
            f'<rect x="{BAR_X}" y="{y - 10}" width="{BAR_WIDTH}" height="11" fill="none" stroke="#94a3b8"/>'
            f'<rect x="{left:.1f}" y="{y - 10}" width="{abs(offset):.1f}" height="11"'
            f' fill="{colours.css(colours.THRUST)}"/>'
            f'<text x="216" y="{y}" font-size="11">{pulse} us</text>'
            f'<text x="{WIDTH - 2}" y="{y}" font-size="11" text-anchor="end">{thrust}</text>'
        )
    return "".join(rows)


def _metres(value: float) -> str:
    """Return the format string of a coordinate, so that the text fits its cell."""
    return "{:.2f} m" if abs(value) < 1000.0 else "{:.0f} m"


def _degrees(angle: float) -> str:
    return f"{degrees(angle):+.0f}°"
