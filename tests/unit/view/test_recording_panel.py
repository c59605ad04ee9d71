"""The button that starts and ends a recording."""

import threading
from contextlib import nullcontext
from typing import Any

import pytest

from hil.common.errors import ConfigError
from hil.view.panels.recording import START, STOP, RecordingPanel
from hil.view.sources.recording import ViewRecorder


class Control:
    """A stand-in for a button or a text of viser."""

    def __init__(self, text: str, disabled: bool = False, hint: str | None = None) -> None:
        self.label = self.content = text
        self.disabled, self.hint = disabled, hint
        self.click: Any = None

    def on_click(self, act: Any) -> None:
        self.click = act


class Server:
    """A stand-in for viser's server."""

    def __init__(self) -> None:
        self.gui = self
        self.controls: list[Control] = []

    def add_folder(self, _: str) -> Any:
        return nullcontext()

    def add_button(self, text: str, **options: Any) -> Control:
        return self._add(Control(text, **options))

    def add_markdown(self, text: str) -> Control:
        return self._add(Control(text))

    def _add(self, control: Control) -> Control:
        self.controls.append(control)
        return control


class Recording(ViewRecorder):
    """A stand-in for the recorder."""

    state, fails = "", False

    def __init__(self) -> None: ...

    def start(self) -> str:
        if self.fails:
            raise ConfigError("disk full")
        self.state = "0 messages into there"
        return "recording into there"

    def stop(self) -> str:
        self.state = ""
        return "7 messages recorded: there"


@pytest.fixture(autouse=True)
def run_threads_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run each thread's function when the thread starts."""

    class Thread:
        def __init__(self, target: Any, **_: Any) -> None:
            self.start = target

    monkeypatch.setattr(threading, "Thread", Thread)


def test_a_recording_is_started_reported_and_ended() -> None:
    server, recorder, reported = Server(), Recording(), list[str]()
    panel = RecordingPanel(server, nullcontext(), recorder, reported.append)
    button, text = server.controls
    assert (button.label, button.disabled) == (START, False)
    button.click(None)
    panel.update()
    assert button.label == STOP
    assert text.content == "0 messages into there"
    button.click(None)
    panel.update()
    assert button.label == START
    assert text.content == "7 messages recorded: there"
    recorder.fails = True
    button.click(None)
    assert reported == ["recording into there", "7 messages recorded: there", "disk full"]
