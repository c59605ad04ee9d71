"""The button that starts and stops a recording."""

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hil.common.errors import HilError

if TYPE_CHECKING:
    from hil.view.sources.recording import ViewRecorder

START, STOP = "start recording", "stop recording"
NOTHING_TO_RECORD = "only vehicles on the network are recorded here: this is a recording, or a simulation"


class RecordingPanel:
    """The button. Without `recorder` it is disabled and shows why. `report` is called with the outcome."""

    def __init__(
        self, server: Any, container: Any, recorder: "ViewRecorder | None", report: Callable[[str], None]
    ) -> None:
        self._recorder, self._report = recorder, report
        with container, server.gui.add_folder("recording"):
            self._button = server.gui.add_button(
                START, disabled=recorder is None, hint=NOTHING_TO_RECORD if recorder is None else None
            )
            self._state = server.gui.add_markdown(NOTHING_TO_RECORD if recorder is None else "")
        self._button.on_click(lambda _: threading.Thread(target=self._toggle, name="recording", daemon=True).start())

    def update(self) -> None:
        """Show the state of the recording."""
        if self._recorder is None:
            return
        state = self._recorder.state
        if state:
            self._state.content = state
        label = STOP if state else START
        if self._button.label != label:
            self._button.label = label

    def _toggle(self) -> None:
        """Start or stop the recording. It runs in a separate thread, because both may wait for the network."""
        assert self._recorder
        try:
            text = self._recorder.stop() if self._recorder.state else self._recorder.start()
        except HilError as error:
            text = str(error)
        self._state.content = text
        self._report(text)
