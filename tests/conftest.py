"""Settings of all tests: profiles of random examples, time limits, and detailed assertions in shared modules too."""

import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.common.ports import free_ports
from hil.ros import dialect, topics
from tests.support.examples import register_profiles
from tests.support.once import made_once

# As the commands that grid a seabed set it: threads of the linear algebra only wait for each other on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
register_profiles()
pytest_plugins = ["tests.support.firmware.firmware_fixtures"]
pytest.register_assert_rewrite(
    "tests.support.links.link_contract",
    "tests.support.links.mavlink_peer",
    "tests.support.processes",
    "tests.support.firmware.stm32_contract",
    "tests.support.flights.level_flight",
    "tests.support.clients.imaging_slave",
)


# Whoever starts the tests may ignore these (nohup, a shell's background job), and all their processes with them.
signal.signal(signal.SIGHUP, signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def _own_scenario(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Restore the process-wide ROS settings that a test's scenario has loaded."""
    monkeypatch.setattr(dialect, "_chosen", (dialect.FROM_ENVIRONMENT, "jazzy"))
    before = dict(topics.TOPICS)
    yield
    if len(topics.TOPICS) != len(before):  # a user's own sensor
        topics.TOPICS.clear()
        topics.TOPICS.update(before)


@pytest.fixture(autouse=True)
def _own_scheduling() -> Iterator[None]:
    """Restore the scheduling: after a loop in this process all later tests would have real-time priority."""
    if not hasattr(os, "sched_getscheduler"):
        yield
        return
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    yield
    if os.sched_getscheduler(0) != before[0]:
        os.sched_setscheduler(0, *before)


@pytest.fixture(autouse=True)
def _own_library_threads() -> Iterator[None]:
    """Remove what a command in this process chose for zenoh's threads: slaves of later tests would inherit it.

    With the single thread of a recorder a slave cannot pass on large messages.
    """
    before = os.environ.get("ZENOH_RUNTIME")
    yield
    if before is None:
        os.environ.pop("ZENOH_RUNTIME", None)
    else:
        os.environ["ZENOH_RUNTIME"] = before


def pytest_sessionstart() -> None:
    """Reserve ports once: the socket that reserves them stays open, and is no leak of a test."""
    free_ports(1)


SYSTEM_TESTS = Path(__file__).parent / "system"
DEFAULT_RECORDINGS = (
    Path(__file__).parent.parent / "recordings"
)  # where `uuv-hil recording make` and slaves write by default


@pytest.fixture(autouse=True)
def _no_recordings_in_the_repository() -> Iterator[None]:
    """Fail a test that records into the repository: it has to name a folder of its own."""
    before = DEFAULT_RECORDINGS.exists()
    yield
    assert before or not DEFAULT_RECORDINGS.exists(), f"{DEFAULT_RECORDINGS} was made: give the recording tmp_path"


MAX_SECONDS = 300  # for a test, whatever else the machine does: one that takes longer hangs
MAX_SYSTEM_SECONDS = 600  # for one that starts emulators and benchmarks


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Limit the time of each test, unless it or its folder has another limit."""
    if config.pluginmanager.hasplugin("timeout"):
        for item in items:
            if not item.get_closest_marker("timeout"):
                is_system = SYSTEM_TESTS in item.path.parents
                item.add_marker(pytest.mark.timeout(MAX_SYSTEM_SECONDS if is_system else MAX_SECONDS))


def pytest_collection_finish() -> None:
    """Keep what was imported and collected out of later garbage collections: a tenth of the time of a run."""
    gc.freeze()


@pytest.fixture(scope="session")
def binaries(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Compile the C twins once, for `tests.support.flights.twins.taken_from`. Skips where there is no compiler."""
    from tests.support.flights.twins import compiled

    return made_once(tmp_path_factory, "native", compiled)


@pytest.fixture
def native(binaries: Path) -> Iterator[None]:
    """Let the imports of the C twins find those that were compiled from the present sources."""
    from tests.support.flights.twins import taken_from

    with taken_from(binaries):
        yield
