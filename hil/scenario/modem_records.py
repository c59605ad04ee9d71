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
from sim.sensors.error import ErrorModel


class Modem(NamedTuple):
    """The [modem] table: `slot` is each vehicle's slot length (s), 0 for none; `model` has the modem's own keys.

    A member with `usbl` interrogates another one every `usbl_period` and measures its direction, with the error
    `usbl_angle` (rad), by default that of [sensors.usbl].
    """

    slot: Annotated[float, Range(0.0, 60.0, "s")] = 0.25
    usbl_period: Annotated[float, Range(0.1, 600.0, "s")] = 2.0
    usbl_angle: ErrorModel = ErrorModel(noise=0.005)
    model: AcousticModem = AcousticModem()  # read by read_modem


def read_modem(table: dict[str, Any], where: str) -> Modem:
    """Read the [modem] table of a scenario. Raises ConfigError."""
    if "model" in check_table(table, where):
        raise ConfigError(f"{where}: no key 'model': its keys are written in [modem] itself")
    modem, model = parse_split(table, Modem, AcousticModem, where)
    return cast(Modem, modem)._replace(model=cast(AcousticModem, model))
