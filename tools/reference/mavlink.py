"""The page of the MAVLink vehicle, out of its tables: modes, messages, commands, parameters."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.gateways.mavlink import dispatch
from hil.gateways.mavlink.commands import Commands
from hil.gateways.mavlink.flight.mission_items import WAYPOINTS, WITHOUT_PLACE
from hil.gateways.mavlink.flight.modes import MODES
from hil.gateways.mavlink.protocols import newer_messages as newer
from hil.gateways.mavlink.protocols.parameters import GATEWAY
from hil.gateways.mavlink.protocols.streams import DEFAULT_HZ

HEAD = """\
# MAVLink vehicle

What [`uuv-hil mavlink`](../how-to/qgroundcontrol.md) speaks: MAVLink 2, component 1, a submarine. This page is made by
`python -m tools.reference` from `hil/gateways/mavlink/`.

"""
SLAVE = """
Parameters of the slave, which last as long as it runs: `G_LOOP_KEY` are the gains of its controller (loops `SURGE`,
`SWAY`, `HEAVE`, `RLLR`, `PITR`, `YAWR`, `DEPTH`, `HDG`, `ROLL`, `PITCH`; keys `P`, `I`, `D`, `LIM`, `FF`, `FILT`,
`SLEW`); `FAIL1_KIND` is what is wrong with thruster 1 (0 nothing, 1 off, 2 efficiency, 3 stuck, 4 delayed, 5 noisy),
`FAIL1_VALUE` how much: a share, µs, s, a share.
"""
TYPES = {getattr(dialect, f"MAV_PARAM_TYPE_{word}"): word.lower() for word in ("INT8", "INT16", "INT32", "REAL32")}
NEWER = {kind.id: kind.name for kind in (newer.EscStatus, newer.CurrentMode, newer.AvailableModesMonitor)}


def page() -> str:
    """Return the text of the document."""
    return HEAD + "\n".join([_modes(), _messages(), _commands(), _mission(), _parameters()])


def _modes() -> str:
    rows = [f"| {mode.value} | {text.name} | {text.meaning} |\n" for mode, text in MODES.items()]
    return "## Modes\n\n| number | name | what it does |\n|---|---|---|\n" + "".join(rows)


def _messages() -> str:
    names = {number: NEWER.get(number) or dialect.mavlink_map[number].msgname for number in DEFAULT_HZ}
    ordered = sorted(DEFAULT_HZ.items(), key=lambda row: names[row[0]])
    rows = [f"| {names[number]} | {rate:g} |\n" for number, rate in ordered]
    text = (
        "## Messages that are streamed\n\nUntil a ground station asks for another rate, up to 50 Hz. What the vehicle "
        "does not\nmeasure is not sent. Pulse widths are new at `[ros] joints`, 10 Hz. Turns and currents of ESCs are "
        "there where a\nthruster's model has them: both with the T200's `curve`, turns with a rotor's `dynamics`. "
        "The water's temperature\nis not measured.\n\n"
    )
    return text + "| message | Hz |\n|---|---|\n" + "".join(rows)


def _commands() -> str:
    none: Any = None  # the table alone is looked at
    numbers = [*Commands(none).numbers(), *dispatch.ASKING]
    words = sorted({_command_name(number) for number in numbers})
    listed = "\n".join([f"- `{word}`" for word in words])
    return f"## Commands\n\nAll others are acknowledged as unsupported.\n\n{listed}\n"


def _mission() -> str:
    listed = "\n".join([f"- `{_command_name(number)}`" for number in (*WAYPOINTS, *WITHOUT_PLACE)])
    text = "Frames: global, relative to home, local NED. Commands for cameras and mounts are passed over."
    return f"## Items of a mission\n\n{text}\n\n{listed}\n"


def _parameters() -> str:
    rows = [
        f"| `{name}` | {TYPES[p.kind]} | {p.default:g} | {p.least:g} to {p.most:g} | {p.meaning} |\n"
        for name, p in sorted(GATEWAY.items())
    ]
    text = (
        "## Parameters\n\nStored on the machine that serves MAVLink. Forces and `NAV_STEER` follow the vehicle where a "
        "scenario\nnames it.\n\n"
        "| name | type | default | range | meaning |\n|---|---|---|---|---|\n"
    )
    return text + "".join(rows) + SLAVE


def _command_name(number: int) -> str:
    return str(dialect.enums["MAV_CMD"][number].name)
