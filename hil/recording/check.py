"""Simulate a slave's recording again and compare the vehicle's states bit by bit.

A fresh simulation of the recorded scenario gets the recorded pulses, each from its step on. What persons did to the
vehicle is repeated. The sensors' samples are encoded as the slave did, and compared with the recorded messages byte by
byte, in order. Controller and thruster link are not run again, because the pulses contain their result.
"""

from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple

from hil.common.errors import ConfigError
from hil.recording.events import EVENTS, decode_event, repeat
from hil.recording.mcap_file import EPOCHS, PULSES, Message
from hil.recording.reader import About, read_about, read_messages
from hil.recording.run import require_run
from hil.recording.stamps import Stamps
from hil.ros import encoders as ros
from hil.ros.topics import DESCRIPTIONS, TOPICS
from hil.scenario.config import build_simulation
from sim.sensors.variances import error_variances

LONGEST_SILENCE_S = 20.0  # simulated time without a sample, after which none is expected
# Topics that a slave receives, and those that it publishes which are no samples.
COMMANDS = {topic.name for topic in TOPICS.values() if topic.from_master}
NOT_SAMPLES = {
    *COMMANDS, *DESCRIPTIONS, "trace", "diagnostics", "thruster_wrench", "joint_states", "motors", "tether",
    "accessories", "/clock", "/tf_static", "/diagnostics", "/parameter_events", "/rosout",
}  # fmt: skip


class Verdict(NamedTuple):
    """Result: `compared` messages of `steps` steps were equal; `difference` describes the first unequal one, or ""."""

    compared: int
    steps: int
    difference: str


def check(path: str, own_classes: bool = False) -> Verdict:
    """Repeat the run of the recording at `path`; `own_classes`: see `read_run`.

    Raises ConfigError if the recording cannot be repeated.
    """
    about = read_about(path)
    if "epoch_ns" not in about.facts:
        raise ConfigError(f"{path}: only a slave's own recording can be repeated ([recording] slave = true)")
    return _Repetition(about, path, own_classes).run(read_messages(path))


class _Repetition:
    """State of the repeated run."""

    def __init__(self, about: About, path: str, own_classes: bool) -> None:
        run = require_run(about, path, own_classes)
        self._path = path
        sensors = {
            name: fitted for name, fitted in run.scenario.sensors.items() if not fitted.offloaded
        }  # pictures are not
        self._simulation = build_simulation(run.scenario._replace(sensors=sensors), run.vehicle, run.world)
        self._stamps = Stamps(int(about.facts["epoch_ns"]), 0)
        self._step_ns = int(about.facts["step_ns"])
        self._lacks_files = about.facts.get("file", "0") != "0"  # the first are removed when there are too many
        self._prefix = run.scenario.ros.frame_prefix
        self._variances = error_variances(sensors, run.world)
        node = run.scenario.slave.node
        others = NOT_SAMPLES if run.scenario.ros.transforms else NOT_SAMPLES | {"/tf"}
        self._samples = {topic.full_name(node): name for name, topic in TOPICS.items() if name not in others}
        self._names = {name: full for full, name in self._samples.items()}
        self._pulses_topic, self._events_topic = PULSES.full_name(node), EVENTS.full_name(node)
        self._epochs_topic = EPOCHS.full_name(node)
        self._pulses: tuple[int, ...] = ()
        self._steps = 0
        self._repeated: deque[tuple[str, bytes]] = deque()
        self._numbers: dict[str, int] = {}

    def run(self, messages: Iterator[Message]) -> Verdict:
        """Compare the recorded messages with the simulation's, up to the first difference."""
        compared = 0
        for message in messages:
            if message.topic == self._pulses_topic:
                self._check_number(message)
                self._change_pulses(message)
            elif message.topic == self._events_topic:
                self._check_number(message)
                self._repeat_event(message)
            elif message.topic == self._epochs_topic:
                self._check_number(message)
                self._begin_epoch(message)
            elif message.topic in self._samples:
                self._check_number(message)
                expected = self._next()
                if expected != (message.topic, message.data):
                    return Verdict(compared, self._steps, self._difference(message, expected))
                compared += 1
        if not compared:
            raise ConfigError(f"{self._path}: no samples to compare are in it; record a longer run")
        return Verdict(compared, self._steps, "")

    def _check_number(self, message: Message) -> None:
        """Check that no message of the recording is missing."""
        last = self._numbers.get(message.topic, 0)
        self._numbers[message.topic] = message.sequence
        if message.sequence == last + 1:
            return
        if not last:
            remedy = "raise [recording] total_size" if self._lacks_files else "record it again"
            raise ConfigError(
                f"{self._path}: its beginning is missing ({message.topic} begins with message {message.sequence}), so "
                f"the run cannot be repeated; {remedy}"
            )
        raise ConfigError(f"{self._path}: {message.sequence - last - 1} messages of {message.topic} are missing in it")

    def _change_pulses(self, message: Message) -> None:
        values = ros.decode_int64_array(message.data)
        self._go_to(values[0] if values else -1)
        self._pulses = tuple(values[1:]) if values else ()

    def _begin_epoch(self, message: Message) -> None:
        step, epoch_ns = (ros.decode_int64_array(message.data) or (-1, 0))[:2]
        self._go_to(step)
        self._stamps.begin(self._simulation.time_ns, epoch_ns)

    def _repeat_event(self, message: Message) -> None:
        event = decode_event(message.data)
        self._go_to(event.get("step", -1))
        try:
            repeat(event, self._simulation)
        except ConfigError as error:
            raise ConfigError(f"{self._path}: {error}") from None

    def _go_to(self, step: int) -> None:
        if step < self._steps:
            raise ConfigError(f"{self._path}: the simulation was restarted here; only the part before can be repeated")
        while self._steps < step:
            self._step()

    def _next(self) -> tuple[str, bytes]:
        """Return topic and payload of the simulation's next sample on a recorded topic; empty without one."""
        limit = self._steps + round(LONGEST_SILENCE_S * 1e9) // self._step_ns
        while not self._repeated and self._steps < limit:
            self._step()
        return self._repeated.popleft() if self._repeated else ("", b"")

    def _step(self) -> None:
        sample: Any  # as in the slave's sample_publisher
        for topic, sample in self._simulation.step(self._pulses):
            stamped = sample._replace(time_ns=self._stamps.stamp(sample.time_ns))
            for name, payload in ros.encoder(topic)(stamped, self._prefix, *self._variances.get(topic, ())):
                if name in self._names:
                    self._repeated.append((self._names[name], payload))
        self._steps += 1

    def _difference(self, message: Message, expected: tuple[str, bytes]) -> str:
        topic, data = expected
        seconds = self._steps * self._step_ns / 1e9
        where = f"after {seconds:.4f} s (step {self._steps}), message {message.sequence} of {message.topic}"
        if topic != message.topic:
            return f"{where}: here the repetition says {topic or 'nothing'} instead"
        decode = ros.decoder(self._samples[topic])
        values = [decode(each) if decode else each.hex() for each in (message.data, data)]
        return f"{where}:\n  recorded {values[0]}\n  repeated {values[1]}"
