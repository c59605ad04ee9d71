"""Reference page of the MAVLink vehicle, from its tables: modes, messages, commands, parameters."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.gateways.mavlink import dispatch
from hil.gateways.mavlink.commands import REFUSED as REFUSED_COMMANDS
from hil.gateways.mavlink.commands import Commands
from hil.gateways.mavlink.flight.mission_items import WAYPOINTS, WITHOUT_PLACE
from hil.gateways.mavlink.flight.modes import MODES
from hil.gateways.mavlink.messages import GIVEN, GROUND, OWN_SENSORS, REFUSED, TAKEN
from hil.gateways.mavlink.parameter_table import GATEWAY
from hil.gateways.mavlink.protocols.streams import STREAMS

HEAD = """\
# MAVLink vehicle

What [`uuv-hil gateway mavlink`](../how-to/qgroundcontrol.md) sends and accepts: MAVLink 2, component 1, vehicle type
submarine. This page is made by `python -m tools.reference` from `hil/gateways/mavlink/`.

"""
SLAVE = """
These parameters belong to the slave. They are lost when it ends.

- `HIL_G_LOOP_KEY`: gains of its controller. Values of `LOOP`: `SURGE`, `SWAY`, `HEAVE`, `RLLR`, `PITR`, `YAWR`,
  `DEPTH`, `HDG`, `ROLL`, `PITCH`. Values of `KEY`: `P`, `I`, `D`, `LIM`, `FF`, `FILT`, `SLEW`. The `P` of the last four
  loops are `PSC_POSZ_P`, `ATC_ANG_YAW_P`, `ATC_ANG_RLL_P` and `ATC_ANG_PIT_P`.
"""
TYPES = {getattr(dialect, f"MAV_PARAM_TYPE_{word}"): word.lower() for word in ("INT8", "INT16", "INT32", "REAL32")}


def page() -> str:
    """Return the page of the MAVLink vehicle."""
    return HEAD + "\n".join([_modes(), _messages(), _taken(), _commands(), _mission(), _parameters()])


def _modes() -> str:
    rows = [f"| {mode.value} | {text.name} | {text.meaning} |\n" for mode, text in MODES.items()]
    return "## Modes\n\n| number | name | what it does |\n|---|---|---|\n" + "".join(rows)


def _messages() -> str:
    rows = [f"| {name} | {f'{rate:g}' if rate else 'on request'} |\n" for name, (rate, _) in sorted(STREAMS.items())]
    text = (
        "## Messages that are streamed\n\nThe table has the default rates. A ground station may request other rates, "
        "up to 50 Hz. Quantities that the\nvehicle does not measure are not sent; water temperature is one of them. "
        "`SCALED_IMU2` and `SCALED_IMU3` repeat\nthe one IMU, `SCALED_PRESSURE` the one pressure. A serial line slower "
        "than 230400 bit/s gets each message\nat 1 Hz at most. Pulse widths are updated at the rate `[ros] joints`, "
        "10 Hz by default. Speeds and\ncurrents of ESCs are sent if the model of the thruster has them, as with the "
        "`curve` of the T200.\n\n"
    )
    return text + "| message | Hz |\n|---|---|\n" + "".join(rows)


def _taken() -> str:
    rows = [f"| {name} | {row.meaning} |\n" for name, row in TAKEN.items()]
    refusals = REFUSED | dict.fromkeys(GIVEN, f"{OWN_SENSORS} (from systems {GROUND} and above)")
    refused = [f"| {name} | {reason} |\n" for name, reason in refusals.items()]
    text = (
        "## Messages that are taken and refused\n\nWithout the right to command, those that change something are "
        "denied. Sticks and targets that the mode does\nnot follow are refused by a text, once in 10 s.\n\n"
    )
    others = (
        "\nThese are refused with a text. So is every other message that is addressed to this vehicle; one without "
        "an\naddress is taken for the telemetry of another system.\n\n"
    )
    head = "| message | {} |\n|---|---|\n"
    return text + head.format("meaning") + "".join(rows) + others + head.format("why not") + "".join(refused)


def _commands() -> str:
    none: Any = None  # only the table is used
    numbers = [*Commands(none).numbers(), *dispatch.ASKING]
    words = sorted({_command_name(number) for number in numbers})
    listed = "\n".join([f"- `{word}`" for word in words])
    refused = "".join([f"- `{_command_name(number)}`: {reason}\n" for number, reason in REFUSED_COMMANDS.items()])
    text = "All other commands are acknowledged as unsupported, with a text"
    return f"## Commands\n\n{listed}\n\n{text}. Among them:\n\n{refused}"


def _mission() -> str:
    listed = "\n".join([f"- `{_command_name(number)}`" for number in (*WAYPOINTS, *WITHOUT_PLACE)])
    text = "Positions may be global, relative to home, or local NED. Commands for cameras and mounts are skipped."
    return f"## Items of a mission\n\n{text}\n\n{listed}\n"


def _parameters() -> str:
    rows = {
        group: [
            f"| `{name}` | {TYPES[p.kind]} | {p.unit} | {p.default:g} | {p.least:g} to {p.most:g} | {p.meaning} |\n"
            for name, p in sorted(GATEWAY.items())
            if (p.group == "stored") == (group == "stored")
        ]
        for group in ("effective", "stored")
    }
    table = "| name | type | unit | default | range | meaning |\n|---|---|---|---|---|---|\n"
    text = (
        "## Parameters\n\nNames, types and units are ArduSub's, except those that begin with `HIL_`. They are stored "
        "on the\nmachine that runs the gateway. If the gateway has a scenario, the defaults of forces, moments, "
        "`HIL_STEER`,\n`FRAME_CONFIG` and `BATT_MONITOR` follow from its vehicle.\n\n"
    )
    stored = "\nGround stations ask for these, too. They are stored, and change nothing in this vehicle.\n\n"
    return text + table + "".join(rows["effective"]) + SLAVE + stored + table + "".join(rows["stored"])


def _command_name(number: int) -> str:
    return str(dialect.enums["MAV_CMD"][number].name)
