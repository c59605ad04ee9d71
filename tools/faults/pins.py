"""Record of the STM32's outputs over time, from its own report: all results of the campaign are based on it."""

import threading
import time
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

from hil.links.contract import PWM_NEUTRAL_US

State = Literal["ahead", "astern", "neutral", "other"]


class OutputState(NamedTuple):
    """State of the outputs from `at_s` (monotonic) on, and the `sequence` of the command that caused it."""

    at_s: float
    state: State
    sequence: int


def state_of(pulses: Sequence[int]) -> State:
    """Return "ahead", "astern" or "neutral" if all thrusters agree, else "other". No pulse counts as neutral."""
    off = {0 if pulse == 0 else (pulse > PWM_NEUTRAL_US) - (pulse < PWM_NEUTRAL_US) for pulse in pulses}
    named: dict[int, State] = {1: "ahead", -1: "astern", 0: "neutral"}
    return named[off.pop()] if len(off) == 1 else "other"


class Pins:
    """The record of the outputs; filled in by the thread of the line."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._states: list[OutputState] = [OutputState(time.monotonic(), "neutral", 0)]

    def report(self, pulses: Sequence[int], sequence: int) -> None:
        """Record a report of the STM32."""
        self._add(state_of(pulses), sequence)

    def power_lost(self) -> None:
        """Record that the STM32 has ended and gives no pulses."""
        self._add("neutral", -1)

    @property
    def state(self) -> State:
        """Return the newest state."""
        return self._states[-1].state

    def await_state(self, state: State, seconds: float, poll: Callable[[], object] = lambda: None) -> float:
        """Return when (monotonic s) the outputs reached `state`, also before the call; nan if not within `seconds`."""
        deadline = time.monotonic() + seconds
        while True:
            with self._lock:
                newest = self._states[-1]
            if newest.state == state:
                return newest.at_s
            if time.monotonic() > deadline:
                return float("nan")
            poll()
            time.sleep(0.002)

    def executed(self, state: State, begin_s: float) -> int:
        """Return the number of commands with this state of the outputs that were executed after `begin_s`."""
        with self._lock:
            return sum(seen.state == state and seen.at_s > begin_s for seen in self._states)

    def _add(self, state: State, sequence: int) -> None:
        with self._lock:
            newest = self._states[-1]
            if newest.state != state or (state != "neutral" and newest.sequence != sequence):
                self._states.append(OutputState(time.monotonic(), state, sequence))
