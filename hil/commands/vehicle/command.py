"""`uuv-hil vehicle`: describe a vehicle and what it can do, from its file alone."""

import argparse
from collections.abc import Sequence
from math import degrees
from typing import Any

from hil.autonomy.control.allocation import pseudo_inverse
from hil.commands.vehicle.equipment import tables
from hil.common.columns import aligned, paragraph
from hil.common.errors import ConfigError
from hil.common.options import Number, add_json, add_output, add_plot, add_strict, new_parser
from hil.common.schema import preset_names
from hil.common.text import json_text
from hil.doctor.vehicle.finding import exit_code
from hil.doctor.vehicle.rules import check_vehicle
from hil.doctor.vehicle.subject import Subject
from hil.plots.vehicle_picture import draw
from sim.matrices import square
from sim.vehicle.hydrostatics import afloat
from sim.vehicle.terminal_speed import AXES, AxisCapability, axis_capabilities
from sim.vehicle.thrusters.azimuth import with_turned
from sim.vehicle.thrusters.bank import wrench_matrix
from sim.vehicle.urdf.writer import urdf_of
from sim.vehicle.vehicle import Vehicle, displaced_volume, load_vehicle

EXAMPLES = """\
examples:
  uuv-hil vehicle                                     list the presets
  uuv-hil vehicle bluerov2 --plot bluerov2.png        print its numbers, and draw it
  uuv-hil vehicle mine.toml --strict                  exit with 1 if its findings have a problem or a warning
  uuv-hil vehicle mine.toml --json                    as JSON, for other programs
  uuv-hil vehicle mine.toml --urdf > mine.urdf        for tools of ROS, and simulators
  uuv-hil vehicle --import robot.urdf -o mine.toml    from a URDF or xacro, FLU there, FRD here
  uuv-hil vehicle --import robot.urdf --add rest.toml -o mine.toml
  uuv-hil vehicle --import model.sdf -o mine.toml --flight flight.toml   Gazebo's, with its sensors
"""
GRAVITY = 9.80665
DENSITY = Number(500.0, 2000.0, "kg/m³")


def main(arguments: list[str]) -> int:
    """List the presets, describe one vehicle, or import one; return 0. Raises HilError."""
    options = _parser().parse_args(arguments)
    if (options.add or options.output or options.scenario or options.model) and not options.urdf:
        raise ConfigError("--add, --output, --flight and --model go with --import MODEL")
    if options.scenario and not options.output:
        raise ConfigError("--flight names the vehicle's file: give --output FILE.toml too")
    if options.urdf:
        # numpy, which the descriptions do not need
        from hil.commands.vehicle.import_urdf import Request, convert

        return convert(
            Request(
                options.urdf, options.add, options.output, options.scenario, options.model, options.xacro,
                options.strict,
            )
        )  # fmt: skip
    if options.vehicle is None:
        print(listing())
        return 0
    vehicle, control = load_vehicle(options.vehicle)
    if options.write_urdf:
        print(urdf_of(vehicle, options.prefix), end="")
        return 0
    density = options.density or 1000.0
    findings = list(check_vehicle(Subject(vehicle, control, options.density, name=options.vehicle)))
    if options.json:
        print(json_text(to_json(vehicle, density) | {"findings": [each._asdict() for each in findings]}))
    else:
        found = [paragraph(str(each), "  ") for each in findings] or ["  none"]
        print(describe(vehicle, density), "", "findings", *found, sep="\n")
    if options.plot:
        draw(vehicle, top(vehicle, density), options.plot)
    return exit_code(findings, True) if options.strict else 0


def _parser() -> argparse.ArgumentParser:
    parser = new_parser("vehicle", __doc__, EXAMPLES)
    parser.add_argument("vehicle", metavar="NAME|FILE", nargs="?", help="a preset, or a .toml file")
    add_plot(parser, "draw it from three sides, with its top speeds")
    add_json(parser)
    add_strict(parser)
    parser.add_argument("--urdf", dest="write_urdf", action="store_true", help="print it as URDF, for tools of ROS")
    parser.add_argument("--prefix", metavar="TEXT", default="", help="with --urdf: before the names of links []")
    parser.add_argument(
        "--density", metavar="KG/M3", type=DENSITY, help="density of the water [1000, for findings that of its trim]"
    )
    parser.add_argument(
        "--import", metavar="MODEL", dest="urdf", help="make a vehicle file from a .urdf, .sdf or .xacro"
    )
    parser.add_argument("--add", metavar="FILE.toml", help="with --import: keys that the model lacks, and [[fins]]")
    parser.add_argument("--model", metavar="NAME", help="with --import of a world: which of its models")
    parser.add_argument(
        "--xacro", metavar="NAME=VALUE", action="append", default=[], help="with --import: an argument of a xacro file"
    )
    add_output(parser, "FILE.toml", "with --import: where to write it [the screen]")
    about = "with --import: also write a scenario that flies it, with its sensors"
    parser.add_argument("--flight", metavar="FILE.toml", dest="scenario", help=about)
    return parser


def listing() -> str:
    """Return one line for each preset: mass, thrusters, top surge, top surge that is level, axes it cannot drive."""
    rows: list[tuple[str, ...]] = [("preset", "mass", "thrusters", "surge", "level up to", "cannot drive")]
    for name in preset_names("sim/vehicles"):
        vehicle, _ = load_vehicle(name)
        capabilities = top(vehicle)
        rows.append((
            name, f"{vehicle.mass:.4g} kg", _drives(vehicle), f"{capabilities[0].speed[0]:.2f} m/s",
            f"{vehicle.attitude_limit_speed:g} m/s" if vehicle.attitude_limit_speed else "-",
            ", ".join(capability.axis for capability in capabilities if not capability.driven) or "-",
        ))  # fmt: skip
    return _columns(rows)


def describe(vehicle: Vehicle, density: float = 1000.0) -> str:
    """Return a description of `vehicle` in water of `density` kg/m³, as text for a terminal."""
    matrix = wrench_matrix(vehicle)
    _, rank = pseudo_inverse(matrix)
    capabilities = top(vehicle, density)
    idle = [capability.axis for capability in capabilities if not capability.driven]
    names = [thruster.name for thruster in vehicle.thrusters]
    equipment = [f"{title}\n{_columns(rows)}" for title, rows in _equipment(vehicle)]
    parts = [
        f"{vehicle.name}\n{paragraph(f'source: {vehicle.source}', '  ')}",
        _columns(_body_rows(vehicle, density)),
        "surge to yaw, about the origin\n" + _columns(_coefficient_rows(vehicle)),
        f"thrusters: {len(names)} (m, FRD)\n" + _columns(_place_rows(vehicle)),
        _columns(_limit_rows(vehicle)),
        *equipment,
        paragraph(f"wrench of 1 N of each thruster (N, N m), rank {rank} of 6")
        + "\n"
        + paragraph(f"cannot be driven alone: {', '.join(idle)}" if idle else "every axis can be driven")
        + "\n"
        + _columns([("", *"XYZKMN"), *_number_rows(names, list(zip(*matrix, strict=True)))]),
        paragraph("one axis at a time, thrusters within their limits (roll and pitch: against damping alone)")
        + "\n"
        + _columns(_capability_rows(capabilities)),
    ]
    return "\n\n".join(parts)


def to_json(vehicle: Vehicle, density: float = 1000.0) -> dict[str, Any]:
    """Return the description as plain values: the vehicle's keys, and the figures computed from them."""
    matrix = wrench_matrix(vehicle)
    capabilities = top(vehicle, density)
    return {
        **vehicle._asdict(),
        **{key: [row._asdict() for row in getattr(vehicle, key)] for key in ("thrusters", "fins", "drop_weights")},
        **{key: _plain(getattr(vehicle, key)) for key in ("lift", "cross_flow", "buoyancy_engine")},
        "channels": vehicle.channels,
        "net_weight": net_weight(vehicle, density),
        "wrench_matrix": matrix,
        "rank": pseudo_inverse(matrix)[1],
        "reach": {
            capability.axis: {"force": capability.force, "speed": _finite(capability.speed)}
            for capability in capabilities
        },
        "not_driven": [capability.axis for capability in capabilities if not capability.driven],
    }


def top(vehicle: Vehicle, density: float = 1000.0) -> tuple[AxisCapability, ...]:
    """Return the largest forces and speeds of `vehicle` along each axis in water of `density` kg/m³.

    Its thrust is allocated as the slave allocates it.
    """
    vehicle = with_turned(vehicle)
    return axis_capabilities(vehicle, pseudo_inverse(wrench_matrix(vehicle))[0], density)


def net_weight(vehicle: Vehicle, density: float) -> float:
    """Return the weight less lift in N, positive if it sinks in water of `density` kg/m³."""
    return (vehicle.mass - density * displaced_volume(vehicle, density)) * GRAVITY


def _body_rows(vehicle: Vehicle, density: float) -> list[tuple[str, ...]]:
    net = net_weight(vehicle, density)
    trim = "neutral" if abs(net) < 1e-6 else f"{abs(net):.2f} N {'heavy' if net > 0 else 'light'}"
    length, width, height = vehicle.dimensions
    gravity, buoyancy = vehicle.center_of_gravity, vehicle.center_of_buoyancy
    stability = (gravity[2] - buoyancy[2]) * 1e3
    limit = vehicle.attitude_limit_speed
    return [
        ("mass", f"{vehicle.mass:g} kg"),
        ("size", f"{length:g} x {width:g} x {height:g} m (length, width, height)"),
        ("trim", f"{trim} in water of {density:g} kg/m³, displaces {displaced_volume(vehicle, density) * 1e3:.4g} l"),
        *_floating(vehicle, density),
        ("centres", f"of gravity {_point(gravity)} m, of buoyancy {_point(buoyancy)} m ({stability:.3g} mm above)"),
        ("inertia", " ".join(f"{x:g}" for x in _diagonal(vehicle.inertia, 3)) + " kg m²" + _full(vehicle.inertia, 3)),
        ("Munk moment", " ".join(f"{x:.0%}" for x in vehicle.munk_share) + " of ideal fluid's (roll, pitch, yaw)"),
        *([("attitude", f"lost above {limit:g} m/s of surge, under its own controller")] if limit else []),
    ]


def _floating(vehicle: Vehicle, density: float) -> list[tuple[str, str]]:
    """Return how a vehicle floats whose file has the form of its hull."""
    floating = afloat(vehicle, density, GRAVITY) if vehicle.hull else None
    if floating is None:
        return []
    roll, pitch = floating.metacentres
    bow = f"trimmed by {degrees(floating.trim):.1f} deg (bow up)"
    heights = f"metacentric height {roll:.3g} m in roll, {pitch:.3g} m in pitch"
    return [("afloat", f"draught {floating.draught:.3g} m, {bow}, water plane {floating.waterplane:.3g} m², {heights}")]


def _coefficient_rows(vehicle: Vehicle) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [("", *AXES, "")]
    for name in ("added_mass", "linear_damping", "quadratic_damping"):
        values = getattr(vehicle, name)
        rows.append((name.replace("_", " "), *(f"{x:g}" for x in _diagonal(values, 6)), _full(values, 6).strip()))
    return rows


def _place_rows(vehicle: Vehicle) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [("name", "position", "direction")]
    rows += [(t.name, _point(t.position), " ".join(f"{x:.3f}" for x in t.unit_direction)) for t in vehicle.thrusters]
    return rows


def _limit_rows(vehicle: Vehicle) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [("name", "ahead", "astern", "dead band", "lag")]
    rows += [
        (
            t.name, f"{t.max_forward:.4g} N", f"{t.max_reverse:.4g} N", f"±{t.dead_band_us:g} us",
            f"{t.time_constant * 1e3:.4g} ms",
        )
        for t in vehicle.thrusters
    ]  # fmt: skip
    return rows


def _drives(vehicle: Vehicle) -> str:
    fins = f", {len(vehicle.fins)} fins" if vehicle.fins else ""
    return f"{len(vehicle.thrusters)}{fins}"


def _equipment(vehicle: Vehicle) -> list[tuple[str, list[tuple[str, ...]]]]:
    if not vehicle.has_equipment:
        return []
    return tables(vehicle)


def _plain(record: Any) -> dict[str, Any] | None:
    return record._asdict() if record else None


def _capability_rows(capabilities: tuple[AxisCapability, ...]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [("axis", "force +", "force -", "speed +", "speed -")]
    for capability in capabilities:
        if not capability.driven:
            rows.append((capability.axis, "-", "-", "-", "-"))
            continue
        force, speed = ("N m", "rad/s") if capability.axis in AXES[3:] else ("N", "m/s")
        rows.append((
            capability.axis,
            *(f"{x:.1f} {force}" for x in capability.force),
            *(f"{x:.3f} {speed}" for x in capability.speed),
        ))  # fmt: skip
    return rows


def _number_rows(names: Sequence[str], matrix: Sequence[Sequence[float]]) -> list[tuple[str, ...]]:
    return [(name, *(f"{x + 0.0:.4f}" for x in row)) for name, row in zip(names, matrix, strict=True)]


def _diagonal(values: tuple[float, ...], size: int) -> list[float]:
    matrix = square(values, size)
    return [matrix[i][i] for i in range(size)]


def _full(values: tuple[float, ...], size: int) -> str:
    return " (diagonal of a full matrix)" if len(values) > size else ""


def _point(values: tuple[float, float, float]) -> str:
    return " ".join(f"{x:g}" for x in values)


def _finite(values: tuple[float, float]) -> list[float | None]:
    return [value if abs(value) < float("inf") else None for value in values]


def _columns(rows: list[tuple[str, ...]]) -> str:
    return "\n".join(aligned(rows, indent="  "))
