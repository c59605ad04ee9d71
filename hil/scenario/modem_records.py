"""Record of the scenario section [modem]: the modems through which a fleet's vehicles report to each other.

[modem]
kind = "acoustic"             # or "optical"
slot = "250 ms"               # each vehicle sends at the beginning of its slot; 0: at random, about every report_period
source_level = 168.0          # and any other key of sim.modems.acoustic.AcousticModem, or of optical.OpticalModem

Without this table, reports go over the network without delay or rounding.
"""

from typing import Annotated, Any, Literal, NamedTuple, cast

from hil.common.errors import ConfigError
from hil.common.schema import Range, check_table, parse_split
from sim.modems.acoustic import AcousticModem
from sim.modems.optical import OpticalModem

_MODELS: dict[str, type[AcousticModem] | type[OpticalModem]] = {"acoustic": AcousticModem, "optical": OpticalModem}


class Modem(NamedTuple):
    """The [modem] table: `slot` is each vehicle's slot length (s), 0 for none; `model` has the modem's own keys."""

    kind: Literal["acoustic", "optical"] = "acoustic"
    slot: Annotated[float, Range(0.0, 60.0, "s")] = 0.25
    model: AcousticModem | OpticalModem = AcousticModem()  # read by read_modem


def read_modem(table: dict[str, Any], where: str) -> Modem:
    """Read the [modem] table of a scenario. Raises ConfigError."""
    record = _MODELS.get(str(check_table(table, where).get("kind")), AcousticModem)
    if "model" in table:
        raise ConfigError(f"{where}: no key 'model': its keys are written in [modem] itself")
    modem, model = parse_split(table, Modem, record, where)
    return cast(Modem, modem)._replace(model=model)
