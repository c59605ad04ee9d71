"""The run that a recording is of: scenario, vehicle and world as they were, out of the recording itself."""

import os
import tempfile
from contextlib import nullcontext, suppress
from typing import Any, NamedTuple

from hil.config import Scenario, load_scenario
from hil.errors import ConfigError
from hil.plugins import refusing
from hil.tables import cache_path
from hil.transport.recording_reader import About
from sim.vehicle import Vehicle, load_vehicle
from sim.world import World, load_world

FILES = ("scenario.toml", "vehicle.toml", "world.toml")
REFUSAL = (
    "a recording may come from anybody, and who loads its classes runs what it says; give --own-classes, only if you "
    "trust where this recording comes from"
)


class Run(NamedTuple):
    """What was run."""

    scenario: Scenario
    vehicle: Vehicle
    world: World


def read_run(about: About, path: str, own_classes: bool = False) -> Run | None:
    """What stands in the recording at `path`; None if nothing does.

    A user's own classes ([[force]], [sensors]) are in no recording: with `own_classes` they are looked for as usual,
    else refused. Raises ConfigError for that, and if what was a scenario then is none any more.
    """
    if not about.attachments.keys() >= set(FILES):
        return None
    with tempfile.TemporaryDirectory(prefix="uuv-hil-") as folder:
        files = [os.path.join(folder, name) for name in FILES]
        try:
            for name, file in zip(FILES, files, strict=True):
                with open(file, "w", encoding="utf-8") as out:
                    out.write(about.attachments[name])
            with nullcontext() if own_classes else refusing(REFUSAL):
                return _read(files[0], about.facts)
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
