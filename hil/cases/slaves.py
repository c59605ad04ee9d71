"""Start the vehicles of a case as slave processes, for HIL."""

import time
from collections.abc import Sequence

from hil.cases.process_group import ProcessGroup
from hil.client.client import VehicleClient
from hil.common.errors import NetworkError

READY_S = 20.0
WAIT_STEP_S = 0.02


class Slaves(ProcessGroup):
    """Processes of `uuv-hil slave`, one for each scenario file. A context manager; their logs go to `folder`."""

    def __init__(self, scenarios: list[str], folder: str) -> None:
        super().__init__({f"slave{n}": ["slave", scenario] for n, scenario in enumerate(scenarios, 1)}, folder)

    def wait(self, clients: Sequence[VehicleClient], seconds: float = READY_S) -> None:
        """Wait until every vehicle has sent samples and diagnostics. Raises NetworkError if one does not."""
        deadline = time.monotonic() + seconds
        while not all(client.has_samples and client.diagnostics() for client in clients):
            self.check()
            if time.monotonic() > deadline:
                raise NetworkError(f"a slave sent nothing for {seconds:.0f} s; read its log in {self._folder}")
            time.sleep(WAIT_STEP_S)
