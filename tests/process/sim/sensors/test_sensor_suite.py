"""All sensors together: their rates and messages, repeatability, and imports of carried sensors only."""

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

from hil.ros import encoders as ros
from hil.ros.topics import DESCRIPTIONS, TOPICS
from hil.scenario.config import build_simulation, load_scenario
from sim.environment.world import load_world
from sim.sensors.kinds import SENSORS
from sim.sensors.sensor_set import DEFAULT_SENSORS
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle

ROOT = Path(__file__).parents[4]
RARE = sorted(set(SENSORS) - set(DEFAULT_SENSORS))
BATTERY = """
[battery]
capacity_wh = 266.0
charge = [0.0, 0.1, 1.0]
open_circuit = [12.4, 14.0, 16.8]
resistance = 0.05
"""
WORLD = """
name = "bay"
source = "test"
extent = [-100, 100, -100, 100]
depth = 30
origin = [57.7, 11.9]
origin_altitude = "36 m"
magnetic_field = [50e-6, "70 deg", "4 deg"]
[ocean.waves]
significant_height = "0.5 m"
peak_period = "4 s"
components = 5
[ocean.profile]
depth = [0, 30]
density = [1020.0, 1026.0]
sound_speed = [1510.0, 1490.0]
"""
SCENARIO = """
vehicle = "vehicle.toml"
world = "world.toml"
start = { depth = 0.3 }
[master]
goal = [10, 0]
"""


def scenario(folder: Path, sections: str = "") -> Simulation:
    """Return a vehicle with every sensor that has a section, in a bay with every kind of thing."""
    vehicle = (ROOT / "sim/vehicles/paper_six.toml").read_text().replace("time_constant = 0.05", "")
    (folder / "vehicle.toml").write_text(
        vehicle.replace("[every_thruster]", f'{BATTERY}\n[every_thruster]\ncurve = {{ kind = "t200" }}')
    )
    (folder / "world.toml").write_text(WORLD)
    sections = sections or "".join(f"[sensors.{name}]\n" for name in RARE)
    (folder / "scenario.toml").write_text(SCENARIO + sections)
    read = load_scenario(str(folder / "scenario.toml"))
    return build_simulation(read, load_vehicle(read.vehicle)[0], load_world(read.world))


ON_REQUEST = (  # [ros] images, points, ground_truth; the picture of a fan; `bins` of a scanning sonar
    "camera/image_raw/compressed", "camera/depth/points", "camera/labels", "forward_sonar/fan/image_raw",
    "scanning_sonar/image",
)  # fmt: skip


def test_all_sensors_measure_at_their_rates_and_every_sample_is_encoded(tmp_path: Path) -> None:
    """Every topic in the table of topics has the stated rate, and its messages can be decoded."""
    simulation, counts = scenario(tmp_path), Counter[str]()
    for _ in range(1602):  # 4 s, and two steps for the sound to the station
        for name, sample in simulation.step((1600, 1600, 1600, 1600, 1500, 1500)):
            for topic, payload in ros.encoder(name)(sample, ""):
                decoder = ros.decoder(topic)
                assert decoder is not None
                assert decoder(payload) is not None
                counts[topic] += 1
    others = {"trace", "diagnostics", "thruster_wrench", "joint_states", "motors", "tether", "/clock"}
    others |= {*ON_REQUEST, *DESCRIPTIONS, "accessories", "/tf_static", "/diagnostics", "/parameter_events", "/rosout"}
    ours = {name: topic for name, topic in TOPICS.items() if name not in others and not topic.from_master}
    assert counts == {name: round(4 * topic.rate_hz) for name, topic in ours.items()}


def test_sensor_keys_of_a_scenario_take_effect(tmp_path: Path) -> None:
    sections = """
[sensors.gps]
rate = "5 Hz"
position = [0.0, 0.0, -0.4]
latency = "100 ms"
[sensors.usbl]
station = [0, 0, 2]
drop_out = 0.5
[sensors.leak]
at = "1 s"
"""
    simulation, counts = scenario(tmp_path, sections), Counter[str]()
    for _ in range(4000):
        counts.update(topic for topic, _ in simulation.step((1500,) * 6))
    assert counts["gps"] == 49  # the last one is still under way
    assert counts["leak"] == 10
    assert 1 <= counts["usbl"] <= 9


LEAN = """
import sys
import hil.commands.slave, hil.slave.daemon
from hil.scenario.config import build_simulation, load_scenario
from hil.ros import encoders as ros
from sim.vehicle.vehicle import load_vehicle
from sim.environment.world import load_world
scenario = load_scenario("paper_field")
simulation = build_simulation(scenario, load_vehicle(scenario.vehicle)[0], load_world(scenario.world))
for _ in range(400):
    for topic, sample in simulation.step((1500,) * 6):
        list(ros.encoder(topic)(sample, ""))
print(*sorted(name for name in sys.modules if name.startswith(("sim.", "hil."))))
"""


def test_modules_of_sensors_that_are_not_carried_are_not_loaded() -> None:
    """A second of the usual sensors, up to their messages, loads no others, and no models that no file names."""
    completed = subprocess.run(
        [sys.executable, "-c", LEAN], capture_output=True, text=True, cwd=ROOT, env={**os.environ, "PYTHONPATH": "."}
    )
    assert completed.returncode == 0, completed.stderr
    loaded = set(completed.stdout.split())
    assert "sim.sensors.imu" in loaded
    autopilots = ("hil.autopilots", "hil.slave.autopilot_port", "hil.scenario.autopilot_records", "hil.links.mavlink")
    assert not [name for name in loaded if name.startswith(autopilots)]
    rare = {SENSORS[name].place.partition(":")[0] for name in RARE}
    helpers = {"sim.sensors.extra_samples", "sim.sensors.surface", "sim.geodesy", "hil.ros.sensors"}
    water = {f"sim.environment.{name}" for name in ("water", "waves", "currents", "ocean")}
    thrusters = {f"sim.vehicle.thrusters.{name}" for name in ("curves", "t200", "propulsion")}
    assert not loaded & (rare | helpers | water | thrusters | {"sim.vehicle.battery", "sim.vehicle.failures"})
