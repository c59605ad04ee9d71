"""A station: what reaches its instrument before that has started, and without power."""

from typing import Any

from hil.client.client import Stamped
from hil.common.clock import NS_PER_S
from hil.instruments.camera import NetworkCamera
from hil.instruments.contract import Facts, NoSettings
from hil.instruments.station import Station
from hil.ros.images import Picture
from hil.scenario.instrument_records import InstrumentFaults, InstrumentSpec


def test_an_instrument_takes_samples_only_while_it_is_started() -> None:
    spec = InstrumentSpec("network_camera", (), NoSettings(), InstrumentFaults(power_off=((3.0, 4.0),)))
    scene: Any = None
    station = Station(spec, NetworkCamera, Facts("camera", "camera", None), scene, 0, print, lambda *_: None)
    answers = []
    for seconds in (0.5, 1.5, 3.5):  # the warm-up takes 1 s
        now_ns = round(seconds * NS_PER_S)
        for _ in range(2):
            station.on_sample("camera", Stamped(Picture(0, 1, 1, "jpeg", b"jpeg"), 0, 0), now_ns)
            answers.append(station.on_request("GET", "/", {"action": "snapshot"}, b"", now_ns))
            station.poll(now_ns)
    assert [answer and answer.body for answer in answers] == [None, None, None, b"jpeg", b"jpeg", None]
