"""Settings of all tests: profiles of random examples, time limits, and detailed assertions in shared modules too."""

import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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


def _scheduling() -> tuple[int, Any] | None:
    return (os.sched_getscheduler(0), os.sched_getparam(0)) if hasattr(os, "sched_getscheduler") else None


@pytest.fixture(autouse=True)
def _own_process() -> Iterator[None]:
    """Restore what a test has changed for all later tests of this process: in one fixture, as each takes time.

    These are the ROS settings of a scenario; real-time priority, after a loop in this process; and what a command chose
    for zenoh's threads: with the single thread of a recorder a slave cannot pass on large messages. A test that records
    into the repository fails: it has to name a folder of its own.
    """
    chosen, dialect._chosen = dialect._chosen, (dialect.FROM_ENVIRONMENT, "jazzy")
    named, scheduling, threads = dict(topics.TOPICS), _scheduling(), os.environ.get("ZENOH_RUNTIME")
    had_recordings = DEFAULT_RECORDINGS.exists()
    yield
    dialect._chosen = chosen
    if len(topics.TOPICS) != len(named):  # a user's own sensor
        topics.TOPICS.clear()
        topics.TOPICS.update(named)
    if scheduling and os.sched_getscheduler(0) != scheduling[0]:
        os.sched_setscheduler(0, *scheduling)
    if threads is not None:
        os.environ["ZENOH_RUNTIME"] = threads
    else:
        os.environ.pop("ZENOH_RUNTIME", None)
    assert had_recordings or not DEFAULT_RECORDINGS.exists(), f"{DEFAULT_RECORDINGS} was made: give it tmp_path"


def pytest_sessionstart() -> None:
    """Reserve ports once: the socket that reserves them stays open, and is no leak of a test."""
    free_ports(1)


SYSTEM_TESTS = f"{Path(__file__).parent / 'system'}{os.sep}"
DEFAULT_RECORDINGS = (
    Path(__file__).parent.parent / "recordings"
)  # where `uuv-hil recording make` and slaves write by default


MAX_SECONDS = 300  # for a test, whatever else the machine does: one that takes longer hangs
MAX_SYSTEM_SECONDS = 600  # for one that starts emulators and benchmarks


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Limit the time of each test, unless it or its folder has another limit."""
    if config.pluginmanager.hasplugin("timeout"):
        for item in items:
            if not item.get_closest_marker("timeout"):
                is_system = str(item.path).startswith(SYSTEM_TESTS)
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
