"""The JSON Schema of each kind of file: scenario, fleet, vehicle, world, board, frame."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import boards
from hil.autonomy.control import controller, fin_control
from hil.common.errors import ConfigError
from hil.common.schema import at_place, nearest, preset_names, shortened
from hil.links.frame.layout import FrameLayout
from hil.links.wires.faults import Faults
from hil.master.avoid import AvoidSettings
from hil.scenario import config, fleet_records, modem_records, records
from hil.scenario.instrument_records import InstrumentKeys
from hil.schemas.convert import Converter, Schema, chosen, required, table, tables
from sim.environment import mesh, relief, terrain, world
from sim.environment.things import bottom_map, shapes
from sim.modems.acoustic import AcousticModem
from sim.sensors.kinds import SENSORS
from sim.sensors.mounting import Mounting
from sim.sensors.sensor_set import DEVICES, ONLY_ONE, load_sensor
from sim.vehicle import vehicle
from sim.vehicle.fins import Fin
from sim.vehicle.thrusters import curves as thruster_curves
from sim.vehicle.thrusters.model import Thruster

DRAFT = "http://json-schema.org/draft-07/schema#"
OPEN: Schema = {"type": "object"}
OWN_CLASS: Schema = {
    "type": "string",
    "pattern": r"^[\w.]+:\w+$",
    "description": 'User-defined class, "module:Class"; the other keys are passed to its __init__.',
}


def schema(kind: str) -> Schema:
    """Return the JSON Schema of a kind of file in KINDS. Raises ConfigError for another kind."""
    if kind not in KINDS:
        raise ConfigError(f"unknown kind {shortened(kind)}{nearest(kind, list(KINDS))}; use one of {', '.join(KINDS)}")
    converter = Converter()
    body = KINDS[kind](converter)
    title = f"uuv-hil: {kind} file"
    return {"$schema": DRAFT, "title": title, **body, "definitions": converter.definitions}


def dotted_keys(kind: str) -> list[str]:
    """Return all keys of a kind of file in KINDS in file order; keys in tables have dots, such as "master.speed".

    An array of tables is one key. Raises ConfigError for another kind.
    """
    whole = schema(kind)
    return list(dict.fromkeys(_keys_below(whole, whole["definitions"])))


def _keys_below(node: Schema, definitions: Schema, prefix: str = "") -> Iterator[str]:
    reference = node.get("$ref", "").rpartition("/")[2]
    for part in [definitions[reference]] if reference else [*node.get("allOf", ()), *node.get("anyOf", ())]:
        yield from _keys_below(part, definitions, prefix)
    for name, inner in node.get("properties", {}).items():
        yield from list(_keys_below(inner, definitions, f"{prefix}{name}.")) or [prefix + name]


def _scenario(converter: Converter) -> Schema:
    return table(_scenario_keys(converter), required(config.Scenario))


def _fleet(converter: Converter) -> Schema:
    """Return the schema of a fleet: a scenario with members."""
    return table(_scenario_keys(converter), [*required(config.Scenario), "member"])


def _scenario_keys(converter: Converter) -> dict[str, Schema]:
    user_class = table({"class": OWN_CLASS}, ["class"], other_keys=True)
    faults = {"options": OPEN, "faults": converter.reference(Faults)}
    avoid = converter.keys(AvoidSettings, {"search": {"type": "string"}})
    return converter.keys(config.Scenario, _read_later(converter, config.READERS) | {
        **dict.fromkeys(config.HIDDEN),
        "link": table(converter.keys(records.Link, faults)),
        "planner": table({"class": OWN_CLASS, **avoid}, ["class"], other_keys=True),
        "sensors": _sensors(converter, user_class),
        "force": tables(user_class),
        "member": tables(converter.reference(fleet_records.Member)),
        "modem": table(converter.keys(modem_records.Modem, {"model": None}) | converter.keys(AcousticModem)),
    })  # fmt: skip


def _read_later(converter: Converter, readers: Mapping[str, Any]) -> dict[str, Schema | None]:
    """Return the schemas of the sections whose records `readers` import only if a file has them."""
    sections: dict[str, Schema | None] = {}
    for name, reader in readers.items():
        if isinstance(reader, partial) and hasattr(record := at_place(reader.args[0]), "_fields"):
            row = converter.reference(record)
            sections[name] = tables(row) if reader.args[1] else row
    return sections


def _sensors(converter: Converter, user_class: Schema) -> Schema:
    sections: dict[str, Schema] = {}
    further: list[Schema] = []
    instrument = converter.keys(InstrumentKeys, {"settings": OPEN})
    for name in SENSORS:
        device = {"type": "string", "description": f"Commercial device: {', '.join(preset_names(DEVICES))}."}
        keys = converter.keys(load_sensor(name).Model) | converter.keys(Mounting) | instrument
        sections[name] = table(keys | {"device": device})
        if name not in ONLY_ONE:
            kind = {"enum": [name], "description": "Kind of this additional sensor."}
            further.append(table(keys | {"device": device, "sensor": kind}, ["sensor"]))
    return table(sections, other_keys={"anyOf": [user_class, *further]})


def _vehicle(converter: Converter) -> Schema:
    curves = {kind: _record(converter, record) for kind, record in thruster_curves.CURVES.items()}
    curves["table"]["properties"]["table"] = OPEN
    models = {"curve": chosen(curves)}
    # Keys may be given once for all thrusters, so none is required in the table of a thruster.
    thruster, fin = table(converter.keys(Thruster, models)), table(converter.keys(Fin))
    equipment = {key: reader for key, reader in vehicle.READERS.items() if key != "fins"}
    given = _read_later(converter, equipment) | {"fins": tables(fin), "thrusters": tables(thruster)}
    keys = converter.keys(vehicle.Vehicle, given)
    common = {"every_thruster": thruster, "every_fin": fin, "control": _control(converter)}
    return table(keys | common, required(vehicle.Vehicle))


def _control(converter: Converter) -> Schema:
    family = {"anyOf": [{"enum": ["cascade"]}, OWN_CLASS], "default": "cascade", "description": "Control law."}
    return table({
        "family": family,
        **converter.keys(controller.Gains),
        "fins": converter.reference(fin_control.FinGains),
        "options": OPEN,
    })  # fmt: skip


def _world(converter: Converter) -> Schema:
    by_rule = chosen({kind: _record(converter, record) for kind, record in relief.KINDS.items()})
    ground = {"anyOf": [converter.reference(terrain.StoredKeys), *by_rule["anyOf"]]}
    meshes = tables(converter.reference(mesh.MeshKeys))
    functions = {"mesh": meshes, "visual": meshes, "bottom_map": converter.reference(bottom_map.BottomMapKeys)}
    given = _read_later(converter, world.READERS) | functions | {"terrain": ground}
    keys = converter.keys(world.World, given)
    common = converter.keys(shapes.ShapeKeys, {"kind": None})
    each = {
        kind: table(common | converter.keys(record), [key for key in required(shapes.ShapeKeys) if key != "kind"])
        for kind, record in shapes.KINDS.items()
    }
    keys["shape"] = {**tables(chosen(each)), "description": "Obstacles of a library of shapes."}
    return table(keys, required(world.World))


def _record(converter: Converter, record: Any) -> Schema:
    return table(converter.keys(record), required(record))


KINDS: dict[str, Callable[[Converter], Schema]] = {
    "scenario": _scenario,
    "fleet": _fleet,
    "vehicle": _vehicle,
    "world": _world,
    "board": lambda converter: _record(converter, boards.Board),
    "frame": lambda converter: _record(converter, FrameLayout),
}
