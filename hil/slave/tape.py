"""What a slave records of itself: all it says and is told, and what its run needs to be repeated to the bit.

A run is a function of the scenario, the seed, the pulses at each step and what is done to the vehicle by hand; the
wall clock enters only by way of when that happens. So the topic "pulses" has, whenever they change, the number of the
step from which they hold, and "events" that of the step before which it was put somewhere, or a thruster failed.
"""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Any

from hil import clock
from hil.clock import now_ns, to_wall_ns
from hil.config import Scenario
from hil.slave.loop import Loop
from hil.slave.outbox import Outbox
from hil.topics import TOPICS, Topic
from hil.transport import ros
from hil.transport.recording import Recorder, describe, new_folder
from hil.transport.recording_events import EVENTS, encode_failures, encode_place
from hil.transport.recording_file import PULSES, Message
from hil.transport.recording_mcap import require_library
from sim.failures import Failure

Deliver = Callable[[str, bytes, bytes], None]


class Tape:
    """Records one slave, into `folder`. `epoch_ns` is the wall time (ns since 1970) of simulation time 0.

    Use as a context. Raises ConfigError, MissingExtraError.
    """

    def __init__(self, scenario: Scenario, board: str, epoch_ns: int, report: Callable[[str], None]) -> None:
        options, self._node = scenario.recording, scenario.slave.node
        step_ns = clock.seconds_ns(scenario.slave.step)
        about, files = describe(scenario, "slave", board=board, epoch_ns=str(epoch_ns), step_ns=str(step_ns))
        require_library()  # before there is a folder
        self.folder = new_folder(self._node, options.folder)
        self._recorder = Recorder(self.folder, options, about, files, report)
        self._step_ns = step_ns
        self._pulses: tuple[int, ...] = ()
        self._changes = 0
        self._events = 0

    def __enter__(self) -> "Tape":
        return self

    def __exit__(self, *_: object) -> None:
        self._recorder.close()

    def said(self, topic: Topic, payload: bytes, sequence: int) -> None:
        """Note what the slave publishes."""
        now = to_wall_ns(now_ns())
        self._recorder.put(Message(topic.full_name(self._node), topic.type, sequence, now, now, payload))

    def hearing(self, deliver: Deliver) -> Deliver:
        """`deliver`, with what it gets noted."""

        def note(name: str, payload: bytes, attachment: bytes) -> None:
            now = to_wall_ns(now_ns())
            deliver(name, payload, attachment)
            topic, stamp = TOPICS.get(name), ros.unpack_attachment(attachment)
            if topic is None:  # whatever it is, it was not obeyed
                return
            sequence, sent_ns = (stamp.sequence, stamp.time_ns) if stamp else (0, now)
            self._recorder.put(Message(topic.full_name(self._node), topic.type, sequence, sent_ns, now, payload))

        return note

    def step(self, time_ns: int, pulses: Sequence[int]) -> None:
        """Note the pulses (us) of the step that begins at this simulation time, if they are others than before."""
        if tuple(pulses) == self._pulses:
            return
        self._pulses = tuple(pulses)
        self._changes += 1
        self.said(PULSES, ros.encode_int64_array([time_ns // self._step_ns, *pulses]), self._changes)

    def placed(self, time_ns: int, *pose: Sequence[float]) -> None:
        """Note that the vehicle was put somewhere at this simulation time: position, quaternion, nu."""
        self._event(encode_place(time_ns // self._step_ns, *pose))

    def failed(self, time_ns: int, failures: Sequence[Failure]) -> None:
        """Note that thrusters were let fail, or repaired."""
        self._event(encode_failures(time_ns // self._step_ns, failures))

    def _event(self, payload: bytes) -> None:
        self._events += 1
        self.said(EVENTS, payload, self._events)

    def outbox(self, *arguments: Any) -> Outbox:
        """An outbox that is recorded."""
        outbox = _RecordedOutbox(*arguments)
        outbox.tape = self
        return outbox

    def loop(self, *arguments: Any) -> Loop:
        """A loop whose pulses are recorded, and what is done to its vehicle."""
        loop = _RecordedLoop(*arguments)
        loop.tape = self
        return loop


def open_tape(scenario: Scenario, board: str, epoch_ns: int, report: Callable[[str], None], stack: ExitStack) -> Tape:
    """The tape of a slave, closed with `stack`; `report` is told where it is. Raises ConfigError, MissingExtraError."""
    tape = stack.enter_context(Tape(scenario, board, epoch_ns, report))
    report(f"recording into {tape.folder}")
    return tape


class _RecordedOutbox(Outbox):
    sends_all = True
    tape: Tape

    def put(self, name: str, payload: bytes) -> None:
        """Publish a message, and note it."""
        super().put(name, payload)
        self.tape.said(TOPICS[name], payload, self._publishers[name].sequence)


class _RecordedLoop(Loop):
    tape: Tape

    def advance(self, steps: int) -> None:
        """Step by step, each with its pulses noted; nothing changes them meanwhile."""
        for _ in range(steps):
            self.tape.step(self.simulation.time_ns, self.pwm_us)
            super().advance(1)

    def place(self, position: Sequence[float], quaternion: Sequence[float], nu: Sequence[float]) -> None:
        """Put the vehicle somewhere, and note it."""
        super().place(position, quaternion, nu)
        self.tape.placed(self.simulation.time_ns, position, quaternion, nu)

    def fail(self, *failures: Failure) -> None:
        """Let thrusters fail, and note it."""
        super().fail(*failures)
        self.tape.failed(self.simulation.time_ns, failures)
