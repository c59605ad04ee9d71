"""Pitch and roll of vehicles under their own controller, over the commanded speed."""

from collections.abc import Sequence

from matplotlib.axes import Axes

from hil.common.schema import preset_names
from sim.vehicle.vehicle import load_vehicle
from tests.support.flights.level_flight import FIELD, MAX_TILT, OPEN, LevelFlight, fly_level, top_speed
from tools.validations.sheet import Finding, Sheet, label

SHARES = (0.5, 0.75, 1.0)


def level_flight(panels: Sequence[Axes]) -> list[Finding]:
    """The greatest pitch and roll during a flight, at half, three quarters and all of the top speed. Vehicles
    without fins cross the field with obstacles. Vehicles with fins fly in open water, and pitch to dive. Vehicles with
    published parameters that contain the full Munk moment of an ideal fluid tip over. Their files give the speed at
    which this happens as attitude_limit_speed."""
    findings = []
    for name in sorted(preset_names("sim/vehicles"), key=lambda name: load_vehicle(name)[0].attitude_limit_speed or 0):
        vehicle, _ = load_vehicle(name)
        speeds = [share * top_speed(name) for share in SHARES]
        flown = [fly_level(name, speed, OPEN if vehicle.fins else FIELD, 120.0) for speed in speeds]
        panel = panels[1 if vehicle.attitude_limit_speed else 0]
        panel.plot(speeds, [max(0.1, run.tilt) for run in flown], "o-", markersize=3, label=name)
        findings.append(_finding(name, vehicle.attitude_limit_speed, bool(vehicle.fins), flown))
    for panel, title in zip(panels, ("up to the top speed", "published sets to the letter"), strict=True):
        panel.set_yscale("log")
        panel.set_ylim(0.08, 200.0)
        panel.axhline(MAX_TILT, color="k", linewidth=0.8, linestyle=":")
        label(panel, "commanded surge (m/s)", "greatest tilt (deg)", title)
        panel.legend(fontsize=5, loc="lower right" if panel is panels[1] else "upper right")
    return findings


def _finding(name: str, limit: float | None, swims: bool, flown: list[LevelFlight]) -> Finding:
    pitch, roll = (", ".join(f"{getattr(run, key):.1f}" for run in flown) for key in ("pitch", "roll"))
    top = top_speed(name)
    what = f"{name}, top speed {top:.2f} m/s"
    angles = f"pitch {pitch}°; roll {roll}°"
    worst = max(one.tilt for one in flown)
    if limit:
        return Finding(what, angles, f"level to {limit:g} m/s", worst > MAX_TILT)
    if swims:
        return Finding(what, angles, "tilt < 20°", worst < 20.0)
    return Finding(what, angles, f"tilt < {MAX_TILT:g}°", worst < MAX_TILT)


SHEETS = [Sheet("Level flight", level_flight, size=(9.0, 3.6))]
