"""Reference page of the MAVLink vehicle, from its tables: modes, messages, commands, parameters."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.gateways.mavlink import dispatch
from hil.gateways.mavlink.commands import Commands
from hil.gateways.mavlink.flight.mission_items import WAYPOINTS, WITHOUT_PLACE
from hil.gateways.mavlink.flight.modes import MODES
from hil.gateways.mavlink.parameter_table import GATEWAY
from hil.gateways.mavlink.protocols.streams import STREAMS

HEAD = """\
# MAVLink vehicle

What [`uuv-hil gateway mavlink`](../how-to/qgroundcontrol.md) sends and accepts: MAVLink 2, component 1, vehicle type
submarine. This page is made by `python -m tools.reference` from `hil/gateways/mavlink/`.

"""
SLAVE = """
These parameters belong to the slave. They are lost when it ends.

- `G_LOOP_KEY`: gains of its controller. Values of `LOOP`: `SURGE`, `SWAY`, `HEAVE`, `RLLR`, `PITR`, `YAWR`, `DEPTH`,
  `HDG`, `ROLL`, `PITCH`. Values of `KEY`: `P`, `I`, `D`, `LIM`, `FF`, `FILT`, `SLEW`.
- `FAIL1_KIND`: failure of thruster 1 (0 none, 1 off, 2 efficiency, 3 stuck, 4 delayed, 5 noisy).
- `FAIL1_VALUE`: size of that failure. Its unit depends on the kind: a share (2, 5), µs (3), s (4).
"""
TYPES = {getattr(dialect, f"MAV_PARAM_TYPE_{word}"): word.lower() for word in ("INT8", "INT16", "INT32", "REAL32")}


def page() -> str:
    """Return the page of the MAVLink vehicle."""
    return HEAD + "\n".join([_modes(), _messages(), _commands(), _mission(), _parameters()])


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
        "10 Hz by default. Speeds and\ncurrents of ESCs are sent if the model of the thruster has them: both with the "
        "`curve` of the T200,\nspeeds with the `dynamics` of a rotor.\n\n"
    )
    return text + "| message | Hz |\n|---|---|\n" + "".join(rows)


def _commands() -> str:
    none: Any = None  # only the table is used
    numbers = [*Commands(none).numbers(), *dispatch.ASKING]
    words = sorted({_command_name(number) for number in numbers})
    listed = "\n".join([f"- `{word}`" for word in words])
    return f"## Commands\n\nAll other commands are acknowledged as unsupported.\n\n{listed}\n"


def _mission() -> str:
    listed = "\n".join([f"- `{_command_name(number)}`" for number in (*WAYPOINTS, *WITHOUT_PLACE)])
    text = "Positions may be global, relative to home, or local NED. Commands for cameras and mounts are skipped."
    return f"## Items of a mission\n\n{text}\n\n{listed}\n"


def _parameters() -> str:
    rows = [
        f"| `{name}` | {TYPES[p.kind]} | {p.unit} | {p.default:g} | {p.least:g} to {p.most:g} | {p.meaning} |\n"
        for name, p in sorted(GATEWAY.items())
    ]
    text = (
        "## Parameters\n\nThey are stored on the machine that runs the gateway. If the gateway has a "
        "scenario, the defaults of\nthe forces, the moments and `NAV_STEER` follow from its vehicle.\n\n"
        "| name | type | unit | default | range | meaning |\n|---|---|---|---|---|---|\n"
    )
    return text + "".join(rows) + SLAVE


def _command_name(number: int) -> str:
    return str(dialect.enums["MAV_CMD"][number].name)
