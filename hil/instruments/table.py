"""The instruments by their names in a scenario, each with the place of its class, "module:Class"."""

from hil.common.errors import ConfigError
from hil.common.plugins import installed, load_object
from hil.common.schema import nearest, shortened
from hil.instruments.contract import Instrument

INSTRUMENTS: dict[str, str] = {
    "cerulean_s500": "hil.instruments.ping.s500:S500",
    "keller_33x": "hil.instruments.keller:Keller33X",
    "paroscientific_digiquartz": "hil.instruments.paroscientific:Digiquartz",
    "network_camera": "hil.instruments.camera:NetworkCamera",
    "ping1d": "hil.instruments.ping.ping1d:Ping1D",
    "ping2": "hil.instruments.ping.ping1d:Ping2",
    "ping360": "hil.instruments.ping.ping360:Ping360",
    "seatrac": "hil.instruments.seatrac.link:SeatracLink",
    "teledyne_pathfinder": "hil.instruments.dvl.pathfinder:Pathfinder",
    "ublox_m9": "hil.instruments.gps.receiver:Receiver",
    "vectornav_vn100": "hil.instruments.vectornav.unit:Vn100",
    "vectornav_vn200": "hil.instruments.vectornav.unit:Vn200",
    "waterlinked_a50": "hil.instruments.dvl.unit:A50",
    "waterlinked_a125": "hil.instruments.dvl.unit:A125",
    "waterlinked_sonar_3d": "hil.instruments.sonar_3d:Sonar3D",
    "waterlinked_ugps": "hil.instruments.ugps:Ugps",
}


def load_instrument(name: str, where: str) -> type[Instrument]:
    """Return the class of an instrument; `where` (file and key) begins every error message. Raises ConfigError."""
    place = INSTRUMENTS.get(name) or installed("instruments").get(name)
    if place is None:
        known = sorted({*INSTRUMENTS, *installed("instruments")})
        there_are = ", ".join(known)
        raise ConfigError(f"{where}: no instrument {shortened(name)}{nearest(name, known)}; there are: {there_are}")
    found = load_object(place, where)
    if not (isinstance(found, type) and issubclass(found, Instrument)):
        raise ConfigError(f"{where}: {place} is no hil.instruments.contract.Instrument; derive it from that")
    return found
