"""Start the vehicles of a case as slave processes, for HIL."""

import time
from collections.abc import Sequence

from hil.cases.crew import Crew
from hil.client.client import VehicleClient
from hil.common.errors import NetworkError

READY_S = 20.0
WAIT_STEP_S = 0.02


class Slaves(Crew):
    """`uuv-hil slave` for each scenario file, in processes that end with the `with`; their logs go into `folder`."""

    def __init__(self, scenarios: list[str], folder: str) -> None:
        super().__init__({f"slave{n}": ["slave", scenario] for n, scenario in enumerate(scenarios, 1)}, folder)

    def wait(self, clients: Sequence[VehicleClient], seconds: float = READY_S) -> None:
        """Wait until every vehicle has sent samples and diagnostics. Raises NetworkError if one does not."""
        deadline = time.monotonic() + seconds
        while not all(client.has_samples and client.diagnostics() for client in clients):
            self.check()
            if time.monotonic() > deadline:
                raise NetworkError(f"a slave has sent nothing for {seconds:.0f} s; its log is in {self._folder}")
            time.sleep(WAIT_STEP_S)
