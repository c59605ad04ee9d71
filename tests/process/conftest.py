"""Settings of the tests that start processes and open sessions."""

import pytest

from hil.network.opening import listen
from hil.network.roles import open_master_session
from tests.support.processes import free_port


@pytest.fixture(autouse=True, scope="session")
def _usual_library_threads() -> None:
    """Let zenoh start its usual threads, before a recorder in this process chooses fewer for all later tests."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with listen(endpoint), open_master_session(endpoint):
        pass
