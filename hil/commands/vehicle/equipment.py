"""Describe a vehicle's hull lift, fins, ballast and channels for `uuv-hil vehicle`."""

from math import degrees

from sim.matrices import square
from sim.vehicle.vehicle import Vehicle

Table = list[tuple[str, ...]]


def tables(vehicle: Vehicle) -> list[tuple[str, Table]]:
    """Return the title and rows of each kind of equipment that the vehicle has."""
    channels: Table = [(str(number), name) for number, name in enumerate(vehicle.channels, 1)]
    sections: list[tuple[str, Table]] = [
        ("hull", _hull(vehicle)),
        (f"fins: {len(vehicle.fins)} (m, FRD)", _fins(vehicle)),
        (f"azimuth thrusters: {len(vehicle.azimuths)}", _azimuths(vehicle)),
        ("ballast", _ballast(vehicle)),
        (f"channels: {len(channels)}, in the order of their pulses", channels),
    ]
    return [(title, rows) for title, rows in sections if rows]


def _hull(vehicle: Vehicle) -> Table:
    rows: Table = []
    lift, flow, damping = vehicle.lift, vehicle.cross_flow, vehicle.forward_speed_damping
    if lift:
        plane = "" if lift.plane == "any" else ", in the vertical plane only"
        slope, drag = lift.polar.lift_slope, lift.parasitic_drag
        rows.append(("lift", f"{slope:.3g} /rad, drag {drag:.3g}, of {lift.area:g} m²{plane}"))
    if flow:
        least, most = min(flow.drag), max(flow.drag)
        rows.append(("cross-flow drag", f"{least:g} to {most:g}" if most > least else f"{most:g}"))
    if damping:
        matrix = square(damping, 6)
        full = " (diagonal of a full matrix)" if len(damping) > 6 else ""
        rows.append(("damping by speed ahead", " ".join(f"{matrix[i][i]:g}" for i in range(6)) + full))
    if fading := vehicle.fading_damping:
        power = "" if fading.exponent == 1.0 else f"^{fading.exponent:g}"
        numbers = " ".join(f"{x:g}" for x in fading.damping)
        rows.append(("damping when slow", f"{numbers}, times exp(-{fading.rate:g} U{power})"))
    return rows


def _fins(vehicle: Vehicle) -> Table:
    rows: Table = [
        (
            fin.name, _vector(fin.position), _vector(fin.axis), f"{fin.area * 1e4:.4g} cm²",
            f"{fin.polar.lift_slope:.3g} /rad", f"±{degrees(fin.max_deflection):.3g} deg",
            f"{degrees(fin.stall_angle):.3g} deg", f"{fin.time_constant * 1e3:.4g} ms",
        )
        for fin in vehicle.fins
    ]  # fmt: skip
    head = ("name", "position", "turns about", "area", "lift", "deflection", "stall", "lag")
    return [head, *rows] if rows else []


def _azimuths(vehicle: Vehicle) -> Table:
    turned = [(thruster.name, thruster.azimuth) for thruster in vehicle.thrusters if thruster.azimuth]
    rows: Table = [
        (name, f"±{degrees(one.max_deflection):.3g} deg", f"{degrees(one.rate):.3g} deg/s" if one.rate else "any")
        for name, one in turned
    ]
    return [("name", "angle", "rate"), *rows] if rows else []


def _ballast(vehicle: Vehicle) -> Table:
    rows: Table = []
    engine = vehicle.buoyancy_engine
    if engine:
        low, middle, high = (x * 1e6 for x in (engine.min_volume, engine.neutral_volume, engine.max_volume))
        volumes = f"{low:g} to {high:g} cm³, neutral at {middle:g}, {engine.rate * 1e6:g} cm³/s"
        rows.append(("buoyancy engine", f"at {_vector(engine.position)} m", volumes))
    rows += [
        (weight.name, f"at {_vector(weight.position)} m", f"drops {weight.mass:g} kg, {weight.volume * 1e6:g} cm³")
        for weight in vehicle.drop_weights
    ]
    return rows


def _vector(values: tuple[float, float, float]) -> str:
    return " ".join(f"{x:g}" for x in values)
