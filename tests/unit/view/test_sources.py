"""A sample is shown alike from a simulation, a recording or the network."""

from math import inf
from types import SimpleNamespace
from typing import Any

import pytest

from hil.cases.simulated import SimulatedVehicle
from hil.common.clock import NS_PER_S
from hil.recording.mcap_file import Message
from hil.ros import encoders as ros
from hil.ros.diagnostics import Diagnostics
from hil.scenario.config import load_scenario
from hil.view.panels.readings import motion, panel
from hil.view.sources import recorded
from hil.view.sources.recorded import RecordedSource
from hil.view.sources.simulated import SimulatedSource
from sim.sensors.samples import DvlSample, OdometrySample

LOCKED = DvlSample(5, (0.1, 0.0, 0.0), 4.0, locked=True)
ODOMETRY = OdometrySample(7, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), (0.5, 0.0, 0.0, 0.0, 0.0, 0.0))


@pytest.fixture
def vehicle() -> Any:
    simulation = SimulatedVehicle(load_scenario("paper_field")).simulation
    return SimpleNamespace(simulation=simulation, samples={"dvl": LOCKED, "odom": ODOMETRY}, pwm_us=(1500,) * 8)


def recording(monkeypatch: pytest.MonkeyPatch, samples: dict[str, Any]) -> RecordedSource:
    """Return a recording of these samples as the slave encodes them."""
    encoded = [pair for topic, sample in samples.items() for pair in ros.encoder(topic)(sample, "")]
    messages = [
        Message(f"/uuv1/{topic}", "", number, number, number, data) for number, (topic, data) in enumerate(encoded, 1)
    ]
    monkeypatch.setattr(recorded, "read_messages", lambda _: iter(messages))
    source = RecordedSource("dive.mcap")
    source.playback.change(len(messages) / NS_PER_S)
    return source


def test_a_recording_is_shown_like_its_simulation(vehicle: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    simulated = SimulatedSource({"uuv1": vehicle}).latest("uuv1")
    replayed = recording(monkeypatch, vehicle.samples).latest("uuv1")
    for topic in ("odom", "dvl", "altitude"):
        assert type(simulated[topic]) is type(replayed[topic]), topic
    assert simulated["altitude"] == replayed["altitude"] == (5, 4.0)
    moving = motion(replayed)
    assert moving
    assert (tuple(moving["position"]), moving["nu"][0]) == ((1.0, 2.0, 3.0), 0.5)
    both = [panel(newest, Diagnostics(), ([], {})) for newest in (simulated, replayed)]
    assert both[0]["altitude"] == both[1]["altitude"] == 4.0


def test_a_simulated_dvl_without_lock_gives_no_seabed(vehicle: Any) -> None:
    vehicle.samples["dvl"] = LOCKED._replace(locked=False)
    assert SimulatedSource({"uuv1": vehicle}).latest("uuv1")["altitude"].distance == inf
