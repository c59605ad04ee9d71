"""Record of the scenario section [modem]: the modems through which a fleet's vehicles report to each other.

[modem]
slot = "250 ms"               # each vehicle sends at the beginning of its slot; 0: at random, about every report_period
source_level = 168.0          # and any other key of sim.modems.acoustic.AcousticModem

Without this table, reports go over the network without delay or rounding.
"""

from typing import Annotated, Any, NamedTuple, cast

from hil.common.errors import ConfigError
from hil.common.schema import Range, check_table, parse_split
from sim.modems.acoustic import AcousticModem


class Modem(NamedTuple):
    """The [modem] table: `slot` is each vehicle's slot length (s), 0 for none; `model` has the modem's own keys."""

    slot: Annotated[float, Range(0.0, 60.0, "s")] = 0.25
    model: AcousticModem = AcousticModem()  # read by read_modem


def read_modem(table: dict[str, Any], where: str) -> Modem:
    """Read the [modem] table of a scenario. Raises ConfigError."""
    if "model" in check_table(table, where):
        raise ConfigError(f"{where}: no key 'model': its keys are written in [modem] itself")
    modem, model = parse_split(table, Modem, AcousticModem, where)
    return cast(Modem, modem)._replace(model=cast(AcousticModem, model))
