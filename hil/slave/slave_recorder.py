"""Record what a slave publishes and receives, and what is needed to repeat its run bit by bit.

A run is a function of the scenario, the seed, the pulse widths at each step, and manual changes to the vehicle; the
wall clock affects only when these happen. Three topics record them, each with the number of the first step concerned:
"pulses" when the pulse widths change, "events" when the vehicle is moved or a thruster fails, "epochs" when stamps
continue from another epoch.
"""

from collections.abc import Callable, Sequence
from contextlib import ExitStack

from hil.common import clock
from hil.common.clock import now_ns, to_wall_ns
from hil.recording.events import EVENTS, encode_failures, encode_place
from hil.recording.mcap_file import EPOCHS, PULSES, Message
from hil.recording.mcap_writer import require_library
from hil.recording.recorder import Recorder, describe, new_folder
from hil.ros import encoders as ros
from hil.ros.topics import TOPICS, Topic
from hil.scenario.config import Scenario
from sim.vehicle.failures import Failure

Deliver = Callable[[str, bytes, bytes], None]


class SlaveRecorder:
    """Record one slave into `folder`, as an observer of its loop.

    `epoch_ns` is the wall time (ns since 1970) of simulation time 0. Use as a context manager.
    Raises ConfigError, MissingExtraError.
    """

    def __init__(self, scenario: Scenario, board: str, epoch_ns: int, report: Callable[[str], None]) -> None:
        options, self._node = scenario.recording, scenario.slave.node
        step_ns = clock.seconds_ns(scenario.slave.step)
        about, files = describe(scenario, "slave", board=board, epoch_ns=str(epoch_ns), step_ns=str(step_ns))
        require_library()  # before the folder is made
        self.folder = new_folder(self._node, options.folder)
        self._recorder = Recorder(self.folder, options, about, files, report)
        self._step_ns = step_ns
        self._pulses: tuple[int, ...] = ()
        self._changes = 0
        self._events = 0
        self._epochs = 0

    def __enter__(self) -> "SlaveRecorder":
        return self

    def __exit__(self, *_: object) -> None:
        self._recorder.close()

    def record_published(self, topic: Topic, payload: bytes, sequence: int) -> None:
        """Record a message that the slave publishes."""
        now = to_wall_ns(now_ns())
        self._recorder.put(Message(topic.full_name(self._node), topic.type, sequence, now, now, payload))

    def record_received(self, deliver: Deliver) -> Deliver:
        """Return a function that passes each message to `deliver` and records it."""

        def receive(name: str, payload: bytes, attachment: bytes) -> None:
            now = to_wall_ns(now_ns())
            deliver(name, payload, attachment)
            topic, stamp = TOPICS.get(name), ros.unpack_attachment(attachment)
            if topic is None:  # an unknown topic: the message was not used
                return
            sequence, sent_ns = (stamp.sequence, stamp.time_ns) if stamp else (0, now)
            self._recorder.put(Message(topic.full_name(self._node), topic.type, sequence, sent_ns, now, payload))

        return receive

    def record_step(self, time_ns: int, pulses: Sequence[int]) -> None:
        """Record the pulse widths (us) of the step that begins at this simulation time, if they changed."""
        if tuple(pulses) == self._pulses:
            return
        self._pulses = tuple(pulses)
        self._changes += 1
        self.record_published(PULSES, ros.encode_int64_array([time_ns // self._step_ns, *pulses]), self._changes)

    def record_state(self, time_ns: int, *pose: Sequence[float]) -> None:
        """Record that the vehicle was moved at this simulation time: position, quaternion, nu."""
        self._record_event(encode_place(time_ns // self._step_ns, *pose))

    def record_failures(self, time_ns: int, failures: Sequence[Failure]) -> None:
        """Record that thrusters failed or were repaired."""
        self._record_event(encode_failures(time_ns // self._step_ns, failures))

    def record_epoch(self, time_ns: int, epoch_ns: int) -> None:
        """Record that stamps count from another epoch (ns since 1970) after this simulation time."""
        self._epochs += 1
        self.record_published(EPOCHS, ros.encode_int64_array([time_ns // self._step_ns, epoch_ns]), self._epochs)

    def _record_event(self, payload: bytes) -> None:
        self._events += 1
        self.record_published(EVENTS, payload, self._events)


def open_recorder(
    scenario: Scenario, board: str, epoch_ns: int, report: Callable[[str], None], stack: ExitStack
) -> SlaveRecorder:
    """Return the recorder of a slave, to be closed by `stack`; `report` gets its folder.

    Raises ConfigError, MissingExtraError.
    """
    recorder = stack.enter_context(SlaveRecorder(scenario, board, epoch_ns, report))
    report(f"recording into {recorder.folder}")
    return recorder
