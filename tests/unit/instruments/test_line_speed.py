"""Commands that change the speed of a line: it changes after their answer, and with the power as it was stored."""

from typing import Any

import pytest
from pyubx2 import SET, UBXMessage

from hil.instruments.dvl.pathfinder import Pathfinder
from hil.instruments.gps.receiver import Receiver
from hil.instruments.vectornav.unit import Vn100
from sim.sensors.sensor_set import load_sensor
from tests.support.instrument_bench import Bench

PORT = {"portID": 1, "charLen": 3, "parity": 4, "baudRate": 57_600, "inUBX": 1, "outUBX": 1, "outNMEA": 1}
STORE = UBXMessage("CFG", "CFG-CFG", SET, saveMask=b"\xff\xff\0\0", devBBR=1).serialize()


@pytest.mark.parametrize(
    ("kind", "change", "store"),
    [
        (Vn100, b"$VNWRG,05,57600*XX\r\n", b"$VNWNV*XX\r\n"),
        (Receiver, UBXMessage("CFG", "CFG-PRT", SET, **PORT).serialize(), STORE),
        (Receiver, UBXMessage.config_set(1, 0, [("CFG_UART1_BAUDRATE", 57_600)]).serialize(), STORE),
        (Pathfinder, b"CB711\r", b"CK\r"),
    ],
)
def test_the_speed_changes_after_the_answer(kind: Any, change: bytes, store: bytes) -> None:
    device = Bench(kind, load_sensor(kind.sensors[0]).Model())
    assert device.speeds == []
    answer = device.ask(change)
    assert device.speeds == [(len(answer), 57_600)]
    assert answer
    device.restart()
    assert device.device.baud == kind.baud  # it was not stored
    device.ask(change)
    device.ask(store)
    device.restart()
    assert [baud for _, baud in device.speeds] == [57_600]
