"""The tutorial's own sensor class, run unchanged: in the simulator, in a slave, recorded and echoed."""

import os
import re
import signal
import struct
import subprocess
import sys
from pathlib import Path

import pytest

import hil
from hil.common.tables import parse_toml
from hil.recording.reader import read_messages
from hil.ros import encoders as ros
from hil.scenario.config import build_simulation, load_scenario
from sim.environment.world import load_world
from sim.sensors.own import OwnSample
from sim.vehicle.vehicle import load_vehicle
from tests.support.processes import ROOT, Program, wait_for, write_scenario

OTHER_SENSORS = """
class Bare:
    message = "std_msgs/Float64"
    def begin(self, scene, mounting, random): pass
    def sample(self, time_ns, state): return {"data": state.position[2]} if time_ns % 200_000_000 else None

class Wrong(Bare):
    def sample(self, time_ns, state): return {"date": 1.0}

class Typeless(Bare):
    message = None

class Unknown(Bare):
    message = "std_msgs/msg/Flaot64"

class Deaf:
    message = "std_msgs/msg/Float64"
"""


def from_tutorial(language: str) -> str:
    section = (ROOT / "docs" / "tutorials" / "own_sensor.md").read_text()
    found = re.search(rf"```{language}\n(.*?)```", section, re.DOTALL)
    assert found, f"the tutorial shows no {language} there"
    return found[1]


@pytest.fixture
def sensor_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "my_sensors.py").write_text(from_tutorial("python") + OTHER_SENSORS)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "my_sensors", raising=False)
    return tmp_path


def scenario_with(folder: Path, section: str, top: str = "") -> tuple[Path, int]:
    path, port = write_scenario(folder, top=top)
    path.write_text(path.read_text() + section)
    return path, port


def samples(path: Path, seconds: float, topic: str) -> list[OwnSample]:
    scenario = load_scenario(str(path))
    vehicle, _ = load_vehicle(scenario.vehicle)
    simulation = build_simulation(scenario, vehicle, load_world(scenario.world))
    problems = []
    while simulation.time_ns < seconds * 1e9:
        problems += [sample for name, sample in simulation.step((1500,) * 6) if name == topic]
    return problems  # type: ignore[return-value]


def test_the_sensor_of_the_tutorial_measures_and_has_nine_lines(sensor_folder: Path) -> None:
    assert len([line for line in from_tutorial("python").splitlines() if line.strip()]) == 9
    assert parse_toml(from_tutorial("toml"))["sensors"]["thermometer"]["rate"] == "5 Hz"
    path, _ = scenario_with(sensor_folder, from_tutorial("toml"))
    received = samples(path, 2.0, "thermometer")
    assert [sample.time_ns for sample in received] == [200_000_000 * (k + 1) for k in range(10)]
    warm = [sample.values["temperature"] for sample in received]
    assert sum(warm) / 10 == pytest.approx(18.0 - 0.5 * 2.1, abs=0.03)  # 2 m deep, 0.1 m below the middle
    assert len(set(warm)) == 10
    assert samples(path, 2.0, "thermometer") == received, "the same seed, the same luck"
    ((topic, payload),) = ros.encoder("thermometer")(received[0], "uuv7/")
    decode = ros.decoder(topic)
    assert decode
    back = decode(payload)
    assert (back.time_ns, back.values["temperature"]) == (received[0].time_ns, warm[0])
    assert back.values["header"]["frame_id"] == "uuv7/thermometer_link"
    assert decode(payload[:-9]) is None


def test_a_sensor_may_have_a_short_type_no_header_and_missing_measurements(sensor_folder: Path) -> None:
    section = '[sensors.mine]\nclass = "my_sensors:Bare"\nrate = "10 Hz"\n'
    path, _ = scenario_with(sensor_folder, section)
    received = samples(path, 1.0, "mine")
    assert [sample.time_ns for sample in received] == [100_000_000 * k for k in (1, 3, 5, 7, 9)]
    ((_, payload),) = ros.encoder("mine")(received[0], "")
    assert payload == bytes.fromhex("00010000") + struct.pack("<d", received[0].values["data"])


def test_a_slave_publishes_records_and_repeats_an_own_sensor(sensor_folder: Path) -> None:
    top = f'[recording]\nslave = true\nfolder = "{sensor_folder / "recording"}"'
    path, port = scenario_with(sensor_folder, from_tutorial("toml"), top)
    environment = {"PYTHONPATH": str(sensor_folder)}
    with Program(sensor_folder, "slave", path, environment=environment) as slave:
        slave.expect("ready")
        with Program(
            sensor_folder, "topic", "echo", "/uuv1/thermometer", "-n", "3", "--connect", f"tcp/127.0.0.1:{port}"
        ) as echo:
            assert echo.wait() == 0, echo.output
        load_scenario(str(path))  # from now on Python knows it too
        with hil.connect(f"tcp/127.0.0.1:{port}", wait=60.0) as fleet:
            sample = next(fleet["uuv1"].samples("thermometer"))
            assert sample.values["temperature"] == pytest.approx(16.95, abs=0.1)
            assert wait_for(lambda: fleet["uuv1"].newest("thermometer").age < 1.0)
        assert slave.stop(signal.SIGTERM) == 0, slave.output
    values = [float(text) for text in re.findall(r"temperature: ([\d.]+)", echo.output)]
    assert len(values) == 3
    assert values == pytest.approx([16.95] * 3, abs=0.1)
    assert echo.output.count("frame_id: thermometer_link") == 3
    (recorder,) = (sensor_folder / "recording").iterdir()
    file = next(recorder.glob("*.mcap"))
    reported = [message for message in read_messages(str(file)) if message.topic == "/uuv1/thermometer"]
    assert len(reported) >= 3
    assert {message.type for message in reported} == {"sensor_msgs/msg/Temperature"}
    with Program(
        sensor_folder, "recording", "replay", recorder, "--check", "--own-classes", environment=environment
    ) as check:
        assert check.wait() == 0, check.output


def test_a_planner_receives_an_own_sensor_in_simulation_and_over_the_network(sensor_folder: Path) -> None:
    (sensor_folder / "warm.py").write_text(
        "from hil.autonomy.control.controller import VelocityCommand\n"
        "from hil.master.planner import Done, Planner\n"
        "class Warm(Planner):\n"
        "    def command(self, time, samples):\n"
        "        found = samples.get('thermometer')\n"
        "        return Done(f\"{found.values['temperature']:.1f} degrees\") if found else VelocityCommand()\n"
    )
    path, _ = scenario_with(sensor_folder, from_tutorial("toml") + '[planner]\nclass = "warm:Warm"\n')
    environment = {"PYTHONPATH": str(sensor_folder)}
    for command in (("sim", path, "--fast"), ("demo", path, "--output", sensor_folder / "run")):
        with Program(sensor_folder, *command, environment=environment) as program:
            assert program.wait() == 0, program.output
        reported = re.search(r"([\d.]+) degrees", program.output)
        assert reported, program.output
        assert float(reported[1]) == pytest.approx(16.95, abs=0.3)


def test_a_slave_with_a_wrong_sensor_message_ends_with_its_name(sensor_folder: Path) -> None:
    path, _ = scenario_with(sensor_folder, '[sensors.mine]\nclass = "my_sensors:Wrong"\nrate = 10\n')
    with Program(sensor_folder, "slave", path, environment={"PYTHONPATH": str(sensor_folder)}) as slave:
        assert slave.wait() == 2, slave.output
    assert "sensors: mine: what it measures is no std_msgs/msg/Float64: no field 'date'" in slave.output


def test_without_own_sensors_no_modules_are_loaded_for_them() -> None:
    script = (
        "import sys; from hil.scenario.config import load_scenario; load_scenario('paper_field')\n"
        "print([m for m in sys.modules if m.endswith(('.own', 'hil.common.plugins', 'modem', 'hil.ros.message'))])"
    )
    completed = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, env={**os.environ}, timeout=30
    )
    assert completed.stdout.strip() == "[]", completed.stderr
