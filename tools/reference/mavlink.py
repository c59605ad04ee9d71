"""Tables of the page of the MAVLink vehicle: modes, messages, commands, parameters."""

from collections.abc import Iterable
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
from tools.reference.records import rows

TYPES = {getattr(dialect, f"MAV_PARAM_TYPE_{word}"): word.lower() for word in ("INT8", "INT16", "INT32", "REAL32")}


def modes() -> str:
    """Return the rows of the flight modes."""
    return rows((mode.value, text.name, text.meaning) for mode, text in MODES.items())


def streamed() -> str:
    """Return the rows of the messages that are streamed."""
    return rows((name, f"{rate:g}" if rate else "on request") for name, (rate, _) in sorted(STREAMS.items()))


def taken() -> str:
    """Return the rows of the messages that are taken."""
    return rows((name, row.meaning) for name, row in TAKEN.items())


def refused() -> str:
    """Return the rows of the messages that are refused."""
    return rows((REFUSED | dict.fromkeys(GIVEN, f"{OWN_SENSORS} (from systems {GROUND} and above)")).items())


def commands() -> str:
    """Return the list of the commands that are taken."""
    none: Any = None  # only the table is used
    return _listed(sorted({_command_name(number) for number in [*Commands(none).numbers(), *dispatch.ASKING]}))


def refused_commands() -> str:
    """Return the list of the commands that are refused, with the reasons."""
    return "".join([f"- `{_command_name(number)}`: {reason}\n" for number, reason in REFUSED_COMMANDS.items()])


def mission_items() -> str:
    """Return the list of the items of a mission."""
    return _listed(_command_name(number) for number in (*WAYPOINTS, *WITHOUT_PLACE))


def parameters(group: str) -> str:
    """Return the rows of the parameters that are only "stored", or of the "effective" ones."""
    return rows(
        (f"`{name}`", TYPES[p.kind], p.unit, f"{p.default:g}", f"{p.least:g} to {p.most:g}", p.meaning)
        for name, p in sorted(GATEWAY.items())
        if (p.group == "stored") == (group == "stored")
    )


def _listed(names: Iterable[str]) -> str:
    return "\n".join(f"- `{name}`" for name in names)


def _command_name(number: int) -> str:
    return str(dialect.enums["MAV_CMD"][number].name)
