"""Keys of a fleet with TLS: vehicle, planners, a listener, and machines without rights or of another authority."""

from pathlib import Path

import pytest

from hil.commands.keys import add_machine, init

PLANNERS = ("planner1", "planner2", "planner3")


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("keys")
    init(str(folder))
    for name in ("uuv", *PLANNERS, "viewer", "outsider"):
        add_machine(str(folder), name, ["localhost"])
    init(str(folder / "other"))
    add_machine(str(folder / "other"), "planner2", ["localhost"])
    return folder
