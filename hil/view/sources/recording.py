"""Record what the vehicles at some endpoints publish, between the presses of the live view's recording button."""

import threading
from collections.abc import Sequence

from hil.network.security import Security
from hil.network.settings import Network
from hil.recording.recorder import Recorder, describe, new_folder
from hil.recording.tap import Tap
from hil.scenario.config import Scenario
from hil.scenario.records import Recording


class ViewRecorder:
    """Records into a new folder of this machine at each start. Limits and folder are those of `scenario`, if given."""

    def __init__(
        self, endpoints: Sequence[str], network: Network, security: Security | None, scenario: Scenario | None
    ) -> None:
        self._endpoints, self._network, self._security = list(endpoints), network, security
        self._scenario = scenario
        self._running: tuple[Tap, Recorder] | None = None
        self._lock = threading.Lock()

    @property
    def state(self) -> str:
        """Folder and size of the recording, or the reason why it ended; "" without one."""
        running = self._running
        if running is None:
            return ""
        return running[1].failure or f"{running[1].written} messages into {running[1].folder}"

    def start(self) -> str:
        """Start recording, and return a text with its folder. It has no effect while a recording runs.

        Raises ConfigError, MissingExtraError, NetworkError.
        """
        with self._lock:
            if self._running is None:
                self._running = self._begin()
            return f"recording into {self._running[1].folder}"

    def stop(self) -> str:
        """Stop recording; return a text with the number of messages and the folder. It has no effect if none runs."""
        with self._lock:
            if self._running is None:
                return "no recording runs"
            (tap, recorder), self._running = self._running, None
        recorder.close()
        tap.close()
        lost = f", {recorder.lost + tap.missed} lost" if recorder.lost + tap.missed else ", none lost"
        return recorder.failure or f"{recorder.written} messages recorded{lost}: {recorder.folder}"

    def _begin(self) -> tuple[Tap, Recorder]:
        scenario = self._scenario
        options = scenario.recording if scenario else Recording()
        about, files = describe(scenario, "view") if scenario else ({"recorded_by": "view"}, {})
        tap = Tap(self._endpoints, self._network, self._security)
        folder = new_folder(scenario.slave.node if scenario else "view", options.folder)
        about["endpoints"] = " ".join(self._endpoints)
        recorder = Recorder(folder, options, about, files, source=tap.receive)
        return tap.__enter__(), recorder
