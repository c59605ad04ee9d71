"""The keys that make a sensor an instrument at its own wire, beside the sensor's own keys.

[sensors.dvl]
rate = "15 Hz"                             # the most that the instrument can have
instrument = "waterlinked_a50"             # hil/instruments/table.py
at = "tcp:0.0.0.0:16171"                   # or several: ["tcp:...", "serial:/dev/ttyUSB0:115200"]
settings = { speed_of_sound = 1480 }       # of that instrument
faults = { unplugged = [[20, 25]] }
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple

from hil.common.errors import ConfigError
from hil.common.plugins import load_object
from hil.common.schema import Range, check_table, parse
from hil.scenario.mavlink_records import device_and_baud, host_and_port
from sim.sensors.sensor_set import SensorSet, read_sensors

FORMS = "tcp:HOST:PORT, udp:HOST:PORT, udpout:HOST:PORT, serial:/dev/ttyUSB0:115200, pty:/tmp/NAME, http:HOST:PORT"
Second = Annotated[float, Range(0.0, 1e9, "s")]
Share = Annotated[float, Range(0.0, 1.0)]


class WireAddress(NamedTuple):
    """The parts of an address; `target` is a host, a device or the name of a pty, `port` for those two a speed."""

    kind: str
    target: str
    port: int


class InstrumentFaults(NamedTuple):
    """Faults of an instrument and its cables. Times are [from, until] in s since its process began.

    In `power_off` it is without power, and warms up afterwards; in `unplugged` its cable carries nothing. `drop` is the
    share of its messages that are lost, `corrupt` the share of bytes with a wrong bit, `noise` the share of messages
    with random bytes before them.
    """

    power_off: tuple[tuple[Second, Second], ...] = ()
    unplugged: tuple[tuple[Second, Second], ...] = ()
    drop: Share = 0.0
    corrupt: Share = 0.0
    noise: Share = 0.0


class InstrumentKeys(NamedTuple):
    """The keys beside the sensor's own: name of the instrument, its addresses, its settings, and its faults."""

    instrument: str
    at: tuple[str, ...] = ()
    settings: Mapping[str, Any] = MappingProxyType({})
    faults: InstrumentFaults = InstrumentFaults()


class InstrumentSpec(NamedTuple):
    """An instrument of the table, the wires at which it stands, its settings, and its faults."""

    name: str
    at: tuple[WireAddress, ...]
    settings: Any
    faults: InstrumentFaults = InstrumentFaults()


def read_fitted(sections: dict[str, Any], where: str) -> SensorSet:
    """Return the sensors of the `[sensors]` table, those with an instrument with its spec. Raises ConfigError."""
    own = {name: section for name, section in sections.items() if isinstance(section, dict) and "instrument" in section}
    bare = {
        name: {key: value for key, value in section.items() if name not in own or key not in InstrumentKeys._fields}
        if isinstance(section, dict)
        else section
        for name, section in sections.items()
    }
    sensors = dict(read_sensors(bare, where))
    problems: list[str] = []
    for name, section in own.items():
        try:
            spec = _read(section, str(section.get("sensor", name)), f"{where}: {name}")
            if name not in sensors:
                raise ConfigError(f"{where}: {name}: rate: an instrument needs samples: it must be above 0")
            for other, fitted in sensors.items():
                taken = {*spec.at} & {*(fitted.instrument.at if fitted.instrument else ())}
                if taken:
                    raise ConfigError(f"{where}: {name}: at: {other} stands there too: {_text(taken.pop())}")
            sensors[name] = sensors[name]._replace(instrument=spec)
        except ConfigError as error:
            problems += error.args
    if problems:
        raise ConfigError(*problems)
    return sensors


def _text(address: WireAddress) -> str:
    return f"{address.kind}:{address.target}:{address.port}; give one of them another address"


def parse_wire(text: str, baud: int) -> WireAddress:
    """Return the parts of an address; `baud` is the speed of a line that names none. Raises ConfigError."""
    kind, _, address = text.partition(":")
    if kind in ("serial", "pty") and (line := device_and_baud(address, baud)):
        return WireAddress(kind, *line)
    if kind in ("tcp", "udp", "udpout", "http") and (place := host_and_port(address)):
        return WireAddress(kind, *place)
    raise ConfigError(f"{text!r} is not a wire; there are {FORMS}")


def _read(section: dict[str, Any], sensor: str, where: str) -> InstrumentSpec:
    """Return the instrument of a sensor's section, whose kind of sensor is `sensor`. Raises ConfigError."""
    table = {key: value for key, value in section.items() if key in InstrumentKeys._fields}
    keys = parse(table, InstrumentKeys, where, {"settings": check_table})
    # A name, not an import: instruments are above this floor, and most scenarios have none.
    kind = load_object("hil.instruments.table:load_instrument", where)(keys.instrument, f"{where}: instrument")
    if sensor not in kind.sensors:
        is_for = " or ".join(kind.sensors)
        raise ConfigError(f"{where}: instrument: {keys.instrument!r} is no {sensor}: it is for {is_for}")
    texts = keys.at or kind.at
    if not texts:
        raise ConfigError(f"{where}: key 'at' is missing: the address of its wire, one of {FORMS}")
    at = []
    for text in texts:
        try:
            address = parse_wire(text, kind.baud)
        except ConfigError as error:
            raise ConfigError(f"{where}: at: {error}") from None
        if address.kind not in kind.wires:
            known = ", ".join(kind.wires)
            raise ConfigError(f"{where}: at: {text!r}: {keys.instrument} has no {address.kind}: it has {known}")
        at.append(address)
    if len(set(at)) < len(at):
        raise ConfigError(f"{where}: at: a wire is listed twice: remove one")
    settings = parse(dict(keys.settings), kind.Model, f"{where}: settings")
    return InstrumentSpec(keys.instrument, tuple(at), settings, keys.faults)
