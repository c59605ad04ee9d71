"""The run that a recording is of: scenario, vehicle and world as they were, out of the recording itself."""

import os
import tempfile
from contextlib import suppress
from typing import Any, NamedTuple

from hil.config import Scenario, load_scenario
from hil.errors import ConfigError
from hil.tables import cache_path
from hil.transport.recording_reader import About
from sim.vehicle import Vehicle, load_vehicle
from sim.world import World, load_world


class Run(NamedTuple):
    """What was run."""

    scenario: Scenario
    vehicle: Vehicle
    world: World


def read_run(about: About, path: str) -> Run | None:
    """What stands in the recording at `path`; None if nothing does.

    A user's own classes ([[force]]) are in no recording: they are looked for as usual. Raises ConfigError if what was
    a scenario then is none any more.
    """
    if not {"scenario.toml", "vehicle.toml", "world.toml"} <= about.attachments.keys():
        return None
    with tempfile.TemporaryDirectory(prefix="uuv-hil-") as folder:
        files = [os.path.join(folder, os.path.basename(name)) for name in about.attachments]
        try:
            for file, text in zip(files, about.attachments.values(), strict=True):
                with open(file, "w", encoding="utf-8") as out:
                    out.write(text)
            return _read(os.path.join(folder, "scenario.toml"), about.facts)
        except ConfigError as error:
            raise ConfigError(f"{path}: what it says of its run cannot be read: {error}") from None
        finally:
            for file in files:  # they are kept parsed, but nobody will ask for these names again
                with suppress(OSError):
                    os.unlink(cache_path(file))


def _read(path: str, facts: dict[str, str]) -> Run:
    changes: dict[str, Any] = {"vehicle": "vehicle.toml", "world": "world.toml"}
    if facts.get("seed", "").isdigit():
        changes["seed"] = int(facts["seed"])
    scenario = load_scenario(path, changes)
    vehicle, _ = load_vehicle(scenario.vehicle)
    return Run(scenario, vehicle, load_world(scenario.world))
