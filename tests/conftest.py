"""What is shared by tests but is no test module itself explains its assertions too."""

from pathlib import Path

import pytest

pytest.register_assert_rewrite(
    "tests.links.link_contract", "tests.links.mavlink_peer", "tests.processes", "tests.slave.stm32_contract"
)


@pytest.fixture(scope="session")
def binaries(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The C twins, compiled once: for `tests.twins.taken_from`. Skips where there is no compiler."""
    from tests.twins import compiled

    folder = tmp_path_factory.mktemp("native")
    compiled(folder)
    return folder
