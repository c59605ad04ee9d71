"""Restore scenario, vehicle and world of a run from its recording."""

from contextlib import nullcontext
from typing import Any, NamedTuple

from hil.common.errors import ConfigError
from hil.common.plugins import refusing
from hil.common.scratch import ScratchFolder
from hil.recording.reader import About
from hil.scenario.config import Scenario, load_scenario
from sim.environment.world import World, load_world
from sim.vehicle.vehicle import Vehicle, load_vehicle

FILES = ("scenario.toml", "vehicle.toml", "world.toml")
REFUSAL = (
    "a recording may come from anybody, and who loads its classes runs what it says; give --own-classes, only if you "
    "trust where this recording comes from"
)


class Run(NamedTuple):
    """The configuration of a recorded run."""

    scenario: Scenario
    vehicle: Vehicle
    world: World


def read_run(about: About, path: str, own_classes: bool = False) -> Run | None:
    """Return the run that is described in the recording at `path`; None if it has no description.

    A recording does not contain a user's own classes ([[force]], [sensors]). With `own_classes` they are imported as
    usual, otherwise refused. Raises ConfigError if they are refused, or if the recorded scenario is no longer valid.
    """
    if not about.attachments.keys() >= set(FILES):
        return None
    with ScratchFolder("recording") as folder:
        files = [folder.file(name) for name in FILES]
        try:
            for name, file in zip(FILES, files, strict=True):
                with open(file, "w", encoding="utf-8") as out:
                    out.write(about.attachments[name])
            with nullcontext() if own_classes else refusing(REFUSAL):
                return _read(files[0], about.facts)
        except ConfigError as error:
            raise ConfigError(f"{path}: what it says of its run cannot be read: {error}") from None


def require_run(about: About, path: str, own_classes: bool = False) -> Run:
    """Return the run as `read_run` does. Raises ConfigError if the recording does not describe it."""
    run = read_run(about, path, own_classes)
    if run is None:
        raise ConfigError(f"{path}: the recording does not say which scenario it is of; record with --scenario")
    return run


def _read(path: str, facts: dict[str, str]) -> Run:
    # The frame's file is not in the recording; it matters only for the link, which is not run again.
    changes: dict[str, Any] = {"vehicle": "vehicle.toml", "world": "world.toml", "link.frame": "uuv_hil"}
    if facts.get("seed", "").isdigit():
        changes["seed"] = int(facts["seed"])
    scenario = load_scenario(path, changes, option="")
    vehicle, _ = load_vehicle(scenario.vehicle)
    return Run(scenario, vehicle, load_world(scenario.world))
