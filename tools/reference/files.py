"""Reference pages of the file formats: scenario, sensors, vehicle, world, board, frame."""

from typing import Any

import boards
from hil.autonomy.control import controller, fin_control
from hil.autonomy.fleets.formation import FieldSettings
from hil.autonomy.paths.vfh import VfhSettings
from hil.autonomy.tasks.scheduler import Mission, Task
from hil.common.schema import NOUNS, preset_folder, preset_names
from hil.common.tables import read_table
from hil.common.units import SPELLINGS, UNITS
from hil.doctor.vehicle.rules import RULES, words
from hil.links.dronecan import settings as dronecan
from hil.links.frame import layout
from hil.links.mavlink.settings import MavlinkSettings
from hil.links.vesc.end import VescSettings
from hil.links.wires.faults import Faults
from hil.master.avoid import AvoidSettings
from hil.network.security import Security
from hil.network.settings import Network
from hil.scenario import autopilot_records, config, fleet_records, mavlink_records, modem_records, records
from hil.scenario.instrument_records import InstrumentFaults, InstrumentKeys
from sim import tether
from sim.environment import bottom, mesh, obstacles, ocean, relief, terrain, wind, world
from sim.environment.things import bottom_map, pipelines, shapes, zones
from sim.modems.acoustic import AcousticModem
from sim.sensors.error import ErrorModel
from sim.sensors.kinds import SENSORS
from sim.sensors.mounting import Mounting
from sim.sensors.sensor_set import DEFAULT_SENSORS, DEVICES, load_sensor
from sim.vehicle import accessories, ballast, battery, body_lift, collision_shape, fins, hull_form, meshes, vehicle
from sim.vehicle.failures import Failure
from sim.vehicle.thrusters import curves
from sim.vehicle.thrusters.model import Azimuth, Thruster
from tools.reference.records import Section, describe

TABLES = ("tether",
    "master", "slave", "link", "start", "network", "ros", "recording", "security", "planner", "hunting", "modem",
    "autopilot",
    "mavlink",
)  # fmt: skip
NUMBERS = (
    "A number whose unit is in [this table](scenario.md#units) is written as an SI number (`0.2`) or as text with a "
    'unit (`"200 ms"`, `"200ms"`). All other numbers are written without a unit. '
    "Where an array has no fixed length, one value stands for an array of one. "
    "A key that is not in these tables is an error. A path is relative to the file that names it."
)


def _units() -> str:
    by_unit: dict[str, list[str]] = {}
    for name, (unit, _) in UNITS.items():
        other = f" ({', '.join(f'`{spelling}`' for spelling in SPELLINGS[name])})" if name in SPELLINGS else ""
        by_unit.setdefault(unit, []).append(f"`{name}`{other}")
    rows = "".join(f"| {unit} | {', '.join(names)} |\n" for unit, names in by_unit.items())
    text = "A space before the unit may be left out. Other spellings of a unit are in brackets. "
    text += 'The unit is part of the value, not of a new key: write `heading = "30 deg"`, not `heading_deg = 30`.'
    return f"## Units\n\n{text}\n\n| unit | may be written in |\n|---|---|\n{rows}"


def _page(title: str, text: str, sections: list[Section], *more: str) -> str:
    made = "This page is made by `python -m tools.reference` from the schema that reads the file."
    parts = [f"# {title}\n\n{text}\n\n{NUMBERS} {made}\n", *[describe(section) for section in sections], *more]
    return "\n".join(parts)


def _presets(folder: str) -> str:
    return f"Installed {NOUNS[folder]} files: {', '.join(f'`{name}`' for name in preset_names(folder))}."


def scenario() -> str:
    """Return the page of the scenario file."""
    top = Section("Top level", config.Scenario, hidden=config.HIDDEN, shown_types={
        **{key: f"tables, [`{key}`](#{key})" for key in config.MANY},
        "sensors": "tables, [`sensors.NAME`](sensor_keys.md)",
        **{key: f"table, [`{key}`](#{key})" for key in TABLES},
    }, defaults={"sensors": "[default sensors](sensor_keys.md)", "planner": "`Follow`"})  # fmt: skip
    errors = "table, [ErrorModel](sensor_keys.md#errormodel)"
    sections = [
        top,
        Section("slave", records.Slave),
        Section("start", records.Start),
        Section("master", records.Master, shown_types={
            "allow": "array of events", "waypoint": "tables, [`master.waypoint`](#masterwaypoint)"}),
        Section("master.waypoint", records.Waypoint, defaults={"depth": "that of `master`"}),
        Section("planner", AvoidSettings, "`class` names the planner, `\"module:Class\"`. Its other keys are the "
                "class's own. `hil.master.follow:Follow` is the default and has none. These are the keys of "
                "`hil.master.avoid:Avoid` and `hil.master.tasks:Tasks`.", shown_types={"search": "text"}),
        Section(
            "planner.vfh", VfhSettings, "Settings of VFH+ for `Avoid` and `Tasks`.",
            defaults={"radius": "the vehicle's"},
        ),
        Section("planner.mission", Mission, "The tasks of `hil.master.tasks:Tasks`.", shown_types={
            "task": "tables, [`planner.mission.task`](#plannermissiontask)"}),
        Section("planner.mission.task", Task),
        Section("link", records.Link, shown_types={
            "options": "table, `[link.options]`", "faults": "table, [`link.faults`](#linkfaults)"}),
        Section("link.options of mavlink", MavlinkSettings),
        Section("link.options of dronecan, the host", dronecan.HostSettings),
        Section("link.options of dronecan, the STM32 side", dronecan.DeviceSettings, shown_types={
            "battery": "table, fields of DroneCAN's BatteryInfo"}),
        Section("link.options of vesc", VescSettings),
        Section("link.faults", Faults),
        Section("network", Network),
        Section("security", Security),
        Section("ros", records.Ros),
        Section("recording", records.Recording),
        Section("failure", Failure, "Each `[[failure]]` changes one thruster at a time of the run."),
        Section("release", ballast.Release, "Each `[[release]]` drops a weight of the vehicle."),
        Section("tether", tether.TetherKeys),
        Section("member", fleet_records.Member, "Each `[[member]]` is one vehicle of a fleet."),
        Section("hunting", fleet_records.Hunting, shown_types={"fields": "table, [`hunting.fields`](#huntingfields)"}),
        Section("hunting.fields", FieldSettings),
        Section("mavlink", mavlink_records.Mavlink),
        Section("modem", modem_records.Modem, hidden=("model",), shown_types={"usbl_angle": errors}),
        Section("autopilot", autopilot_records.AutopilotSettings, "The flight controller, where `controller` is one. "
                "The section may be left out. Installed frames: "
                f"{', '.join(f'`{name}`' for name in preset_names('hil/autopilots/frames'))}."),
        Section("modem, acoustic", AcousticModem, shown_types={"range_error": errors}),
    ]  # fmt: skip
    force = '## force\n\nEach `[[force]]` is a class of your own: `class = "module:Class"` and the keys of the class.\n'
    return _page("Scenario file", "A scenario names the vehicle, its world, the thruster link and the planner. "
                 + _presets("hil/scenario/presets"), sections, force, _units())  # fmt: skip


def sensor_keys() -> str:
    """Return the page of the sections `[sensors.NAME]`."""
    default = ", ".join(f"`{name}`" for name in DEFAULT_SENSORS)
    text = (
        f"Each sensor is a section `[sensors.NAME]` of the scenario. These are always fitted: {default}. A rate of 0 "
        "removes one. `device` sets the values of a [product](#devices). Another sensor of a kind is a section of "
        'another name with the kind as `sensor`: `[sensors.camera_down]` with `sensor = "camera"`. Its topics and '
        "frames have that name (`camera_down/image_raw`, `camera_down_optical_frame`), and its random numbers are "
        "independent."
    )
    sections = [
        Section("Every sensor", Mounting),
        Section("ErrorModel", ErrorModel, "The errors of one measured quantity, in its own SI unit."),
        Section(
            "Instrument",
            InstrumentKeys,
            "A sensor that stands at its own wire as an [instrument](instruments.md).",
            shown_types={"settings": "table"},
        ),
        Section("InstrumentFaults", InstrumentFaults),
        *[Section(name, load_sensor(name).Model, f"`[sensors.{name}]`") for name in SENSORS],
    ]
    tables = {name: read_table(f"{preset_folder(DEVICES)}/{name}.toml") for name in preset_names(DEVICES)}
    rows = "".join(f"| `{name}` | `{table['sensor']}` | {table['source']} |\n" for name, table in tables.items())
    devices = (
        "## Devices\n\nValues for `device`. Which number is from where is also said in the files, "
        '`sim/sensors/devices`. A ± that a data sheet does not explain is taken for 1 sigma. "Unverified" numbers '
        f"are commonly given, but were not read in a source.\n\n| device | sensor | source |\n|---|---|---|\n{rows}"
    )
    return _page("Sensors in a scenario", text, sections, devices)


def _findings() -> str:
    rows = "".join(
        f"| {rule.key} | {rule.quantity} | {words(rule.sane, rule.unit)} | {rule.level} | "
        f"{words(rule.absurd, rule.unit)} | {rule.remedy} |\n"
        for rule in RULES
    )
    return (
        "## Findings\n\n`uuv-hil vehicle`, `vehicle --import` and `scenario check` measure these values. One outside "
        "its bounds is reported; outside the wider bounds it is a problem. The flights take 10 s of simulated time.\n\n"
        "| key | measured | expected | else a | a problem unless | what to change |\n|---|---|---|---|---|---|\n"
        f"{rows}"
    )


def vehicle_file() -> str:
    """Return the page of the vehicle file."""
    linked = {
        "battery": "table, [`battery`](#battery)", "fins": "tables, [`fins`](#fins)", "lift": "table, [`lift`](#lift)",
        "cross_flow": "table, [`cross_flow`](#cross_flow)", "drop_weights": "tables, [`drop_weights`](#drop_weights)",
        "fading_damping": "table, [`fading_damping`](#fading_damping)", "meshes": "tables, [`meshes`](#meshes)",
        "buoyancy_engine": "table, [`buoyancy_engine`](#buoyancy_engine)",
        "accessories": "table, [`accessories`](#accessories)",
        "collision": "table, [`collision`](#collision)", "hull": "table, [`hull`](#hull)",
        "windage": "table, [`windage`](#windage)",
        "thrusters": "tables, [`thrusters`](#thrusters)",
    }  # fmt: skip
    sections = [
        Section("Top level", vehicle.Vehicle, shown_types=linked),
        Section("thrusters", Thruster, "Each `[[thrusters]]` is one thruster. Keys that all have in common may be "
                "in `[every_thruster]`.", shown_types={"curve": "table with `kind`",
                                                       "azimuth": "table, [`azimuth`](#azimuth)"}),
        Section("azimuth", Azimuth, "`azimuth = { ... }` of a thruster."),
        *[Section(f"curve {kind}", record, f"`curve = {{ kind = \"{kind}\", ... }}` of a thruster.",
                  shown_types={"table": "table"}) for kind, record in curves.CURVES.items()],
        Section("fins", fins.Fin, "Each `[[fins]]` is one fin. Keys that all have in common may be in `[every_fin]`."),
        Section("lift", body_lift.Lift),
        Section("cross_flow", body_lift.CrossFlow),
        Section("fading_damping", body_lift.FadingDamping),
        Section("buoyancy_engine", ballast.BuoyancyEngine),
        Section("drop_weights", ballast.DropWeight),
        Section("battery", battery.Battery),
        Section("accessories", accessories.AccessoryKeys),
        Section("collision", collision_shape.Collision, shown_types={"spheres": "array of arrays of 4 numbers, in m"}),
        Section("hull", hull_form.HullForm, shown_types={"boxes": "array of arrays of 6 numbers, in m"}),
        Section("windage", hull_form.Windage),
        Section("meshes", meshes.Mesh),
        Section("control", controller.Gains, "Gains of the cascade. `family` chooses another law, `\"module:Class\"` "
                "with its keys in `[control.options]`."),
        Section("AxisGains", controller.AxisGains),
        Section("HoldGains", controller.HoldGains),
        Section("control.fins", fin_control.FinGains),
    ]  # fmt: skip
    return _page("Vehicle file", "A vehicle file has the mass of a vehicle, its hydrodynamics, and its thrusters and "
                 "fins. Body axes are FRD. " + _presets("sim/vehicles"), sections, _findings())  # fmt: skip


def world_file() -> str:
    """Return the page of the world file."""
    linked = {
        "bottom": "table, [`bottom`](#bottom)",
        "ocean": "table, [`ocean`](#ocean)",
        "wind": "table, [`wind`](#wind)",
        "terrain": "table, [`terrain`](#terrain-from-a-file)",
        "mesh": "tables, [`mesh`](#mesh)",
        "visual": "tables, [`mesh`](#mesh)",
        "pipeline": "tables, [`pipeline`](#pipeline)",
        "bottom_map": "table, [`bottom_map`](#bottom_map)",
        "zone": "tables, [`zone`](#zone)",
    }
    sections = [
        Section("Top level", world.World, shown_types=linked),
        Section("Cylinder", obstacles.Cylinder, "Each `[[cylinder]]` is a pile."),
        Section("Box", obstacles.Box, "Each `[[box]]` is a block."),
        Section("mesh", mesh.MeshKeys, "Each `[[mesh]]` is a file: OBJ, STL, DAE, GLB, PLY or OFF."),
        Section("shape", shapes.ShapeKeys, "Each `[[shape]]` is an object of a library. All shapes have these keys."),
        *[Section(f"shape {kind}", record, f"More keys of `kind = \"{kind}\"` in `[[shape]]`.")
          for kind, record in shapes.KINDS.items()],
        Section("pipeline", pipelines.Pipeline, "Each `[[pipeline]]` follows the seabed along a line."),
        Section("zone", zones.Zone, "Each `[[zone]]` is an area with rules."),
        Section("bottom_map", bottom_map.BottomMapKeys, "`[bottom_map]` gives the material of the seabed by position."),
        Section("terrain from a file", terrain.StoredKeys, "Depths as little-endian 32-bit floats, row after row."),
        *[Section(f"terrain {kind}", record, f"`kind = \"{kind}\"` in `[terrain]`.")
          for kind, record in relief.KINDS.items()],
        Section("bottom", bottom.Bottom, "`[bottom]` gives details finer than the grid, for sonars and cameras."),
        Section("ocean", ocean.Ocean),
        *[Section(record.__name__, record) for record in (
            ocean.Layers, ocean.GaussMarkov, ocean.Tide, ocean.Series, ocean.Profile, ocean.Waves)],
        Section("wind", wind.Wind),
    ]  # fmt: skip
    return _page("World file", "A world file has the seabed, the obstacles and the motion of the water. "
                 "Positions are NED. " + _presets("sim/worlds"), sections)  # fmt: skip


def board_file() -> str:
    """Return the page of the board file."""
    kinds: list[Any] = [boards.Recommended, boards.Budgets, boards.Serial, boards.Can, boards.PowerMode]
    sections = [Section("Top level", boards.Board), *[Section(kind.__name__, kind) for kind in kinds]]
    return _page("Board file", "A board file has the properties of a single-board computer, and limits for the slave. "
                 + _presets("boards"), sections)  # fmt: skip


def frame_file() -> str:
    """Return the page of the frame file."""
    kinds: list[Any] = [
        layout.Field,
        layout.Bits,
        layout.MessageLayout,
        layout.Other,
        layout.ChecksumRule,
        layout.Stuffing,
    ]
    sections = [Section("Top level", layout.FrameLayout), *[Section(kind.__name__, kind) for kind in kinds]]
    return _page("Frame file", "A frame file describes the bytes of a thruster protocol. `uuv-hil link frame check "
                 "FILE` explains one. " + _presets("firmware_stub/frames"), sections)  # fmt: skip


PAGES = {
    "scenario": scenario, "sensor_keys": sensor_keys, "vehicle": vehicle_file, "world": world_file,
    "board": board_file, "frame": frame_file,
}  # fmt: skip
