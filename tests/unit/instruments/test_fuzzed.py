"""Much noise and damaged messages on each reader: nothing raises, and it still answers."""

from collections.abc import Callable
from random import Random
from typing import Any

import pytest

from hil.instruments import keller
from hil.instruments.contract import Instrument
from hil.instruments.dvl.pathfinder import Pathfinder
from hil.instruments.dvl.unit import A50
from hil.instruments.gps.receiver import Receiver
from hil.instruments.gps.ubx import frame
from hil.instruments.keller import Keller33X
from hil.instruments.layout import sentence as line
from hil.instruments.paroscientific import Digiquartz
from hil.instruments.seatrac.link import SeatracLink
from hil.instruments.vectornav.unit import Vn200
from sim.sensors.extra_samples import FixSample, PositionSample
from sim.sensors.gps import GpsModel
from sim.sensors.imu import ImuModel
from sim.sensors.pressure import PressureModel
from sim.sensors.ranging.dvl import DvlModel
from sim.sensors.samples import DvlSample, ImuSample, PressureSample
from sim.sensors.usbl import UsblModel
from tests.support.instrument_bench import WALL_NS, Bench
from tests.unit.instruments.test_depth import modbus
from tests.unit.instruments.test_seatrac import command

SIZE = 300_000
SAMPLES = {
    "gps": FixSample(WALL_NS, 57.7, 11.9, 40.0, (4.0, 9.0), True),
    "imu": ImuSample(WALL_NS, (1.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3), (0.0, 0.0, -9.8)),
    "usbl": PositionSample(WALL_NS, (1.0, 2.0, 3.0), (0.1,) * 9),
    "pressure": PressureSample(WALL_NS, 2e5),
    "dvl": DvlSample(WALL_NS, (1.0, 0.1, 0.0), 9.0, True),
}


def of_keller(data: bytes) -> bytes:
    """Return a request of one of Keller's functions with its right size and checksum."""
    functions = list(keller._SIZES)
    function = functions[data[0] % len(functions)]
    body = bytes((250, function)) + (data * 3)[1 : keller._SIZES[function] - 3]
    return body + keller._checksum(body)


# Kind, model of its sensor, a question that is always answered, and messages with any content.
READERS: list[tuple[type[Instrument], Any, bytes, Callable[[bytes], bytes]]] = [
    (Receiver, GpsModel(), frame(0x0A, 4), lambda data: frame(6, data[0] if data else 0, data)),
    (Vn200, ImuModel(), line("VNRRG,01"), lambda data: line("VNWRG," + data.decode("latin-1"))),
    (SeatracLink, UsblModel(), command(1), lambda data: command(*data)),
    (Keller33X, PressureModel(), modbus(250, 8, 0, 0, 1, 2), of_keller),
    (Digiquartz, PressureModel(), b"*0100MN\r\n", lambda data: b"*0100" + data + b"\r\n"),
    (Pathfinder, DvlModel(), b"=== EX?\r", lambda data: b"EX" + data + b"\r"),
    (A50, DvlModel(), b"wcv\n", lambda data: b"wcs,%b,,,,,\n" % data),
]


@pytest.mark.parametrize(("kind", "model", "question", "wrap"), READERS, ids=[row[0].__name__ for row in READERS])
def test_noise_does_no_harm(
    kind: type[Instrument], model: Any, question: bytes, wrap: Callable[[bytes], bytes]
) -> None:
    device, random = Bench(kind, model, origin=(57.7, 11.9)), Random(7)
    sent = 0
    while sent < SIZE:
        content = random.randbytes(random.choice((3, 12, 40, 400)))
        if random.random() < 0.3:
            content = bytes(random.choice(b"0123456789ABCDEF,.=*$#-") for _ in content[:60])
        piece = content if random.random() < 0.3 else wrap(content)
        if random.random() < 0.2:
            at = random.randrange(len(piece))
            piece = piece[:at] + random.randbytes(1) + piece[at + 1 :]
        device.ask(piece)
        device.now_ns += random.choice((0, 1_000_000, 100_000_000))
        sent += len(piece)
        if random.random() < 0.1:  # whatever it was told, it measures on
            device.sample(SAMPLES[device.facts.topic])
    assert device.device.malformed > 30
    device.restart()
    device.ask(b"\r\n")
    device.now_ns += 10_000_000_000
    assert device.ask(question)
