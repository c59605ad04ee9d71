"""The scenario of `--flight`: an imported vehicle with its sensors, and keys that fit both."""

import os
from collections.abc import Iterator, Mapping
from math import ceil
from tempfile import TemporaryDirectory
from typing import Any, get_type_hints

from hil.common.errors import ConfigError
from hil.common.text import toml_text
from hil.doctor.scenario.check import check_scenario
from hil.doctor.vehicle.finding import Finding
from hil.doctor.vehicle.subject import Subject
from hil.scenario.config import load_scenario
from hil.scenario.records import Master, Slave
from sim.sensors.sensor_set import load_sensor, read_sensors

FASTEST = 1000.0  # Hz: shorter steps are too much work for a board
NEAR, FAR = 20.0, 100.0  # m: the goal north and east; far for a vehicle that cannot turn on the spot
SLOWEST = 0.05  # m/s, that a scenario can ask for
UPRIGHT = 30.0  # deg

Sensors = Mapping[str, Mapping[str, Any]]


def check_files(texts: tuple[str, str], names: tuple[str, str]) -> list[Finding]:
    """Return what `scenario check` finds about the texts of a vehicle's and a scenario's file with these names."""
    with TemporaryDirectory() as folder:
        paths = [os.path.join(folder, name) for name in ("vehicle.toml", "scenario.toml")]
        for path, text in zip(paths, texts, strict=True):
            with open(path, "w", encoding="utf-8") as file:
                file.write(text)
        findings = list(check_scenario(load_scenario(paths[1], {"vehicle": paths[0]})))
    named = [text.replace(paths[0], names[0]).replace(paths[1], names[1]) for _, text in findings]
    return [each._replace(text=text) for each, text in zip(findings, named, strict=True)]


def scenario_of(vehicle: str, scenario: str, subject: Subject, sensors: Sensors, notes: list[str]) -> str:
    """Return a scenario with the file `vehicle`, whose path is written relative to that of `scenario`.

    Speed, depth, time limit and integration step fit the vehicle and its sensors; `notes` say what was changed.
    """
    folder = os.path.dirname(os.path.abspath(scenario))
    relative = os.path.relpath(os.path.abspath(vehicle), folder)
    fitting = {name: keys for name, model in sensors.items() if (keys := _fitted(name, dict(model), notes))}
    fastest = max([Slave().step ** -1, *(keys.get("rate", 0.0) for keys in fitting.values())])
    step = [] if fastest * Slave().step <= 1.0 else ["", "[slave]", f"step = {int(1e9 / fastest) * 1e-9:.9g}"]
    if step:
        notes.append(f"The step is {1e3 / fastest:.3g} ms, as a sensor measures {fastest:g} times a second.")
    depth = '"0 m"' if subject.floats else '"5 m"'
    lines = [
        f"description = {to_text(f'{subject.vehicle.name}, imported')}", f"vehicle = {to_text(relative)}",
        'world = "open_water"', *step, "", "[start]", f"depth = {depth}", "",
        "[master]", *_master(subject, notes), f"depth = {depth}",
    ]  # fmt: skip
    for sensor, keys in fitting.items():
        own = [f"[sensors.{sensor}]"]
        own += [f"{key} = {to_text(value)}" for key, value in keys.items() if not isinstance(value, dict)]
        for key, value in keys.items():
            if isinstance(value, dict):
                own += ["", f"[sensors.{sensor}.{key}]", *(f"{k} = {to_text(v)}" for k, v in value.items())]
        if keys.get("sensor", sensor) == "gps":
            own = ["# It needs a world with an origin:", *(f"# {line}".rstrip() for line in own)]
        lines += ["", *own]
    return "\n".join(lines) + "\n"


def _master(subject: Subject, notes: list[str]) -> Iterator[str]:
    """Yield the goal, and speed and time limit if the defaults do not fit. The speed of fins is a default."""
    goal, speed = FAR if subject.vehicle.fins else NEAR, subject.cruise
    yield f"goal = [{goal}, {goal}]"
    while speed > SLOWEST and subject.fly(speed).tilt > UPRIGHT:
        speed *= 0.5
    speed = max(round(speed, 3), SLOWEST)
    if speed < Master().speed and not subject.vehicle.fins:
        notes.append(f"The speed is {speed:g} m/s, which the vehicle reaches upright.")
        yield f"speed = {speed}"
    if (limit := 60.0 + 4.0 * goal / speed) > Master().time_limit:
        yield f"time_limit = {ceil(limit)}"


def _fitted(name: str, keys: dict[str, Any], notes: list[str]) -> dict[str, Any]:
    """Return the keys of a sensor, its rate within its bounds; none if they are not those of a scenario."""
    try:
        model = load_sensor(keys.get("sensor", name)).Model
        most = min(FASTEST, get_type_hints(model, include_extras=True)["rate"].__metadata__[0].high)
        if keys.get("rate", 0.0) > most:
            notes.append(f"The sensor {name} measures {most:g} times a second, not {keys['rate']:g}.")
            keys["rate"] = most
        read_sensors({name: keys}, "sensors")
    except ConfigError as error:
        notes.append(f"Left out: the sensor {name}: {error}.")
        return {}
    return keys


def to_text(value: Any) -> str:
    """Return a value as TOML, without the rounding errors of sines and cosines."""
    return toml_text(value, lambda number: repr(round(float(f"{number:.12g}"), 15) + 0.0))
