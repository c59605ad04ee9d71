"""Controls of simulated or recorded time: pause, step, speed, and a slider if the end is known."""

from math import ceil
from typing import Any

from hil.view.sources.paced_time import PacedTime

SPEEDS = ("0.25", "0.5", "1", "2", "5", "10", "50")


class PlaybackPanel:
    """A folder of controls for `playback`. `server` is a viser.ViserServer."""

    def __init__(self, server: Any, playback: PacedTime) -> None:
        self._playback = playback
        self._moving = False  # True while `update`, not a person, moves the slider
        gui = server.gui
        with gui.add_folder("time"):
            self._pause = gui.add_button("pause")
            step = gui.add_button("one step")
            speed = gui.add_dropdown("times as fast", SPEEDS, initial_value="1")
            self._clock = gui.add_text("seconds", "0.0", disabled=True)
            end = ceil(10.0 * playback.duration) / 10.0
            self._slider = gui.add_slider("at (s)", 0.0, end, 0.1, 0.0) if playback.duration else None
        self._pause.on_click(lambda _: self._toggle())
        step.on_click(lambda _: playback.step())
        speed.on_update(lambda _: setattr(playback, "speed", float(speed.value)))
        if self._slider:
            self._slider.on_update(lambda _: self._seek())

    def update(self) -> None:
        """Show the present time of the playback."""
        now = self._playback.time
        self._clock.value = f"{now:.1f}"
        self._pause.label = "go on" if self._playback.paused else "pause"
        if self._slider and abs(self._slider.value - now) >= 0.1:
            self._moving = True
            self._slider.value = min(round(now, 1), self._playback.duration)
            self._moving = False

    def _toggle(self) -> None:
        self._playback.paused = not self._playback.paused

    def _seek(self) -> None:
        if self._slider and not self._moving:
            self._playback.seek(float(self._slider.value))
