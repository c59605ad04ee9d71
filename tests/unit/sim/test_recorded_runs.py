"""Runs of whole simulations give the recorded figures: every force, sensor and effect with its signs and constants.

A change that is meant to alter a figure records it again: `python -m tests.unit.sim.test_recorded_runs`. Whether the
figures are right is for the tests beside this one; these hold that no change alters them unseen.
"""

import json
import os
import tempfile
from collections.abc import Iterator
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.environment.world import World, load_world
from sim.native import SWITCH
from sim.sensors.error import ErrorModel
from sim.sensors.kinds import SENSORS
from sim.sensors.mounting import Mounting
from sim.sensors.sensor_set import SensorSpec, load_sensor
from sim.simulation import Simulation
from sim.tether import TetherKeys
from sim.vehicle.failures import Failure
from sim.vehicle.thrusters.model import Azimuth
from sim.vehicle.vehicle import load_vehicle
from tests.support.processes import ROOT
from tests.unit.sim.vehicle.test_battery import vehicle_file

RECORD = ROOT / "tests" / "vectors" / "sim_runs.json"
STEP_NS, STEPS = 5_000_000, 240
PICTURES = ("rgb", "port", "starboard", "intensities")
EXACT = 6  # numbers that are recorded one by one; of more, their sums

BAY, SEA, THINGS = ((ROOT / f"tests/vectors/sim_{name}.toml").read_text() for name in ("bay", "sea", "things"))
WORLDS = {"still": BAY, "sea": BAY + SEA, "things": BAY + THINGS, "all": BAY + SEA + THINGS}
MOUNTED = Mounting((0.2, -0.1, 0.15), (0.03, -0.05, 0.2), latency=0.004, misalignment=0.01, jitter=0.003)
DOWN = MOUNTED._replace(orientation=(0.05, -1.2, 0.1))
PLACES = {"camera": DOWN, "altimeter": DOWN, "gps": MOUNTED._replace(position=(0.2, -0.1, -1.0))}
ERRORS = ErrorModel(
    offset=0.3, turn_on=0.2, bias=0.1, bias_time=0.5, noise=0.05, noise_density=0.01, scale=0.02, resolution=1e-4,
    limit=1e9, flicker=0.05, noise_share=0.01, warm_up=0.2, warm_up_time=0.7, outliers=0.3, outlier=0.4,
)  # fmt: skip
FEWER: dict[str, dict[str, Any]] = {
    "camera": {"rate": 2.0, "width": 40, "height": 30, "depth": True, "points": True},
    "forward_sonar": {"rate": 2.0, "beams": 24, "rays": 12, "max_range": 20.0, "range_step": 0.1},
    "side_scan": {"rate": 2.0, "slices": 2, "rays": 40, "max_range": 20.0, "range_step": 0.1},
    "scanning_sonar": {"rate": 4.0, "bins": 60, "slices": 2, "rays": 12, "max_range": 20.0},
    "laser": {"beams": 24}, "profiler": {"beams": 21, "beam_width": 0.03},
    "gps": {"rate": 5.0, "acquisition": 0.3}, "usbl": {"rate": 5.0}, "battery": {"rate": 5.0}, "leak": {"rate": 5.0},
}  # fmt: skip
_LEVELS = {"temperature": 14.0, "salinity": 30.0, "sound_speed": 1490.0, "glint": 6.0, "volume_strength": -70.0,
           "ringing": 0.4, "looks": 3.0, "tvg": 0.9, "gain": 15.0, "contrast": 0.6, "noise_grey": 0.2}  # fmt: skip
OPTIONS: dict[str, dict[str, Any]] = {
    "camera": {"distortion": (-0.2, 0.05, 0.002, -0.003, 0.01), "lamps": 300.0, "lamp_offset": 0.3, "snow": 900.0,
               "lamp_shadows": True, "backscatter": 3.0, "exposure_time": 0.02, "readout_time": 0.03, "water": "7C",
               "read_noise": 12.0, "vignetting": 0.7, "depth_noise": 0.01},
    "forward_sonar": {**_LEVELS, "side_lobes": 15.0, "side_lobe_floor": 25.0, "beam_width": 0.4,
                      "error": ErrorModel(scale=0.02)},
    "side_scan": {**_LEVELS, "depression": 0.6}, "scanning_sonar": {**_LEVELS, "rings": 3, "side_lobes": 16.0},
    "profiler": {"rings": 2, "looks": 2.0, "error": ErrorModel(noise=0.02, scale=0.01)},
    "imu": {"attitude": ERRORS, "acceleration": ERRORS, "angular_velocity": ERRORS, "heading": ERRORS,
            "g_sensitivity": 0.01},
    "usbl": {"station": (3.0, -5.0, 2.0), "assumed_speed": 1480.0, "range": ERRORS, "angle": ERRORS},
    "gps": {"horizontal": ERRORS, "vertical": ERRORS}, "laser": {"error": ErrorModel(noise=0.05, scale=0.02)},
    "pressure": {"error": ERRORS},
    "dvl": {"tilt": 0.5, "velocity": ERRORS, "range": ERRORS, "accuracy": ERRORS, "noise_range": 10.0},
    "odometry": dict.fromkeys(("horizontal", "depth", "attitude", "velocity", "angular_velocity"), ERRORS),
    "magnetometer": {"error_xy": ErrorModel(), "error_z": ErrorModel(), "hard_iron": (2e-6, -1e-6, 3e-6),
                     "soft_iron": (1.1, 0.02, 0.0, 0.01, 0.9, 0.03, 0.0, 0.02, 1.05)},
    "altimeter": {"error": ERRORS}, "current_meter": {"velocity": ERRORS},
    "dvl_water": {"near": 0.8, "far": 2.0, "velocity": ERRORS},
    "ahrs": {"level_time": 0.5, "heading_time": 0.7, "acceleration": ERRORS},
}  # fmt: skip
VEHICLES = (
    "bluerov2_heavy",
    "remus100",
    "tethys",
    "otter",
    "rexrov",
    "eca_a9",
    "lauv",
    "paper_seven",
    "heron",
    "azimuth",
)
CASES = [
    *[f"sensor/{name}/things" for name in SENSORS],
    *[f"sensor/{name}/sea" for name in ("dvl", "gps", "pressure", "usbl", "current_meter", "dvl_water", "camera")],
    *[f"options/{name}/all" for name in OPTIONS],
    *[f"vehicle/{name}/{world}" for name in VEHICLES for world in ("still", "sea")],
    "failures/bluerov2_heavy/still", "tether/bluerov2/all", "collision/paper_six/things",
]  # fmt: skip


def make_world(folder: Path, name: str) -> World:
    path = folder / f"{name}.toml"
    path.write_text(WORLDS[name])
    return load_world(str(path))


def figures(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a sample's field: each, or of many their sums."""
    if isinstance(value, bytes):
        kind = np.float32 if name.endswith(("depth", "points")) else np.uint8
        value = [float(x) for x in np.frombuffer(value, kind)]
    if name.endswith(("latitude", "longitude")):
        value %= 0.1  # so that a metre shows
    if isinstance(value, (bool, int, float)):
        yield name, float(value) if isfinite(value) else -1.0
    elif hasattr(value, "_asdict"):
        for key, part in value._asdict().items():
            yield from figures(f"{name}.{key}", part)
    elif isinstance(value, (tuple, list)):
        numbers = [number for part in value for _, number in figures(name, part)]
        if len(numbers) > EXACT:
            ramp = np.linspace(1.0, 2.0, len(numbers))
            numbers = [float(np.sum(numbers)), float(np.dot(numbers, ramp)), float(np.dot(np.square(numbers), ramp))]
        yield from ((f"{name}.{index}", number) for index, number in enumerate(numbers))


def run(case: str, folder: Path) -> dict[str, float]:
    """Run a case in Python; return the figures of its last samples and of its end."""
    what, subject, place = case.split("/")
    name = "paper_six" if what in ("sensor", "options") else subject
    if subject == "battery":
        name = vehicle_file(folder)
    vehicle, _ = load_vehicle("otter" if name == "azimuth" else name)
    if name == "azimuth":
        turning = [one._replace(azimuth=Azimuth(1.5, rate=2.0), torque=0.02) for one in vehicle.thrusters]
        vehicle = vehicle._replace(thrusters=tuple(turning))
    options: dict[str, Any] = {"sensors": {}, "position": (0.5, -0.3, 5.0)}
    if what in ("sensor", "options"):
        sensor = load_sensor(subject)
        keys = FEWER.get(subject, {}) | (OPTIONS[subject] if what == "options" else {})
        model = sensor.Model(**keys)
        mounting = PLACES.get(subject, MOUNTED)
        options["sensors"] = {subject: SensorSpec(sensor, model, mounting)}
        options["position"] = (0.5, -0.3, 0.3 if subject == "gps" else 5.0)
    elif name in ("otter", "heron", "azimuth") or (place == "sea" and name == "bluerov2_heavy"):
        options["position"] = (0.5, -0.3, 0.05)
    elif what == "failures":
        failing = [{"kind": "efficiency", "efficiency": 0.4}, {"kind": "delayed", "delay": 0.3}, {"kind": "stuck"},
                {"kind": "noisy", "noise": 0.3}, {"kind": "off"}]  # fmt: skip
        rows = zip(vehicle.thrusters, failing, strict=False)
        options["failures"] = [Failure(thruster.name, time=0.2, **row) for thruster, row in rows]  # type: ignore[arg-type]
    elif what == "tether":
        options["tether"] = TetherKeys(
            9.0, (-3.0, 2.0, 0.0), (0.1, 0.0, 0.0), (-0.2, 0.05, -0.1), mass=0.06, segments=6
        )
    elif what == "collision":
        options["position"] = (6.8, 1.1, 9.2)
    simulation = Simulation(vehicle, make_world(folder, place), seed=5, dt_ns=STEP_NS, heading=0.3, **options)
    simulation.state.nu = [0.6, 0.1, -0.05, 0.02, -0.03, 0.1]
    samples, found = dict[str, Any](), dict[str, float]()
    for step in range(STEPS):
        swing = 60 if step < STEPS // 2 else -40
        pulses = [1500 + swing * (1 if channel % 2 else 2) for channel in range(len(vehicle.channels))]
        samples.update(simulation.step(pulses))
    if what not in ("sensor", "options"):
        samples.update(truth=simulation.truth(), forces=simulation.forces(), thrusts=simulation.thrusts)
    if simulation.tether:
        samples["nodes"], samples["tension"] = simulation.tether.nodes, simulation.tether.tension
    samples["contacts"] = simulation.contacts
    for topic, sample in samples.items():
        found.update(figures(topic, sample))
    return {key: float(f"{value:.9g}") for key, value in found.items()}


@pytest.mark.parametrize("case", CASES)
def test_a_run_gives_its_recorded_figures(case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(SWITCH, "0")
    recorded = json.loads(RECORD.read_text())[case]
    shares = {
        key: 1e-3 if set(key.split(".")) & set(PICTURES) else 1e-5 for key in recorded
    }  # of bytes a few may be rounded
    assert run(case, tmp_path) == {
        key: pytest.approx(value, rel=shares[key], abs=1e-7) for key, value in recorded.items()
    }


def record() -> None:
    """Write the figures of all cases."""
    os.environ[SWITCH] = "0"
    with tempfile.TemporaryDirectory() as name:
        runs = {case: run(case, Path(name)) for case in CASES}
    rows = ",\n".join(f"{json.dumps(case)}: {json.dumps(own)}" for case, own in runs.items())
    RECORD.write_text(f"{{\n{rows}\n}}\n")


if __name__ == "__main__":
    record()
