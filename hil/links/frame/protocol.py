"""Protocol of thruster messages as a binary frame that a TOML file describes; no new frame needs code.

`layout.py` documents the keys of such a file. It is read once and compiled to `struct` tables (`forms.py`). Frames are
packed here and found in received bytes by `readers.py`.
"""

import os
from typing import TYPE_CHECKING, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import find_preset
from hil.links.contract import (
    MAX_THRUSTERS,
    Counters,
    Message,
    Protocol,
    ThrusterCommand,
    ThrusterTelemetry,
)
from hil.links.frame.bodies import Kind
from hil.links.frame.forms import Form, Trailer
from hil.links.frame.layout import FrameLayout, MessageLayout, Other
from hil.links.frame.readers import Reader, SyncReader
from hil.links.frame.rules import load_layout
from hil.links.protocols import Role

if TYPE_CHECKING:  # loaded for the frames that need them
    from hil.links.frame.ends import Echo, KeepAlive
    from hil.links.frame.stuffing import Stuffer


class FrameProtocol(Protocol):
    """Encoder and decoder for the frame that the TOML file at `path` describes.

    The attribute `channels` lists the numbers of thrusters that the frame can carry. `role` is the end that uses this
    protocol. It decides which message is received if messages have no id, who sends keep-alives, and whether to find
    the command that a report answers if the report does not carry its number. Without a role none of this is done.
    The argument `channels` is for keep-alives that carry the number of thrusters.
    Raises ConfigError naming the file and the key if the file is wrong.
    """

    def __init__(self, path: str, role: Role | None = None, channels: int = MAX_THRUSTERS) -> None:
        layout, self._trailer, commands, reports = _compile(path)
        self.counters = Counters()
        self.layout, self.role = layout, role
        self._stuffer = _stuffer(layout)
        self.channels = sorted({form.channels for form in commands} & {form.channels for form in reports})
        if not self.channels:
            raise ConfigError(f"{path}: command and telemetry never have the same number of channels")
        others = [(other, self._other_forms(other)) for other in layout.other]
        try:
            self.reader = self._open_reader(commands, reports, others)
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}") from None
        self._to_send = {(form.kind, form.channels): form for form in commands + reports}
        self._keep_alives = self._open_keep_alives(others, channels)
        self._echoes = self._open_echoes(commands, reports)
        self.echoes_sequence = layout.sequence_bits > 0
        self.deadline_ns = 0 if self._keep_alives else Protocol.deadline_ns

    def encode(self, message: Message) -> bytes:
        """Return the frame of `message`.

        A number out of range wraps if it is a counter, and is limited if it is a pulse width or an age. Raises
        ValueError for a number of channels that the frame cannot carry.
        """
        form = self._to_send.get((type(message), len(message.pwm_us)))
        if form is None:
            raise ValueError(f"this frame carries {self.channels} channels, not {len(message.pwm_us)}")
        if self._echoes and isinstance(message, ThrusterCommand):
            self._echoes[form.channels].add_command(message)
        for keep_alive in self._keep_alives:
            keep_alive.is_needless = True
        return self._finish(form, form.body.pack(message))

    def feed(self, data: bytes) -> list[Message]:
        """Return the messages completed by `data`, in order. Never raises; see `Reader.feed` for what is counted."""
        messages = self.reader.feed(data)
        return [self._answering(message) for message in messages] if self._echoes else messages

    def tick(self, now_ns: int) -> bytes:
        """Return the keep-alives that are due at `now_ns` (monotonic)."""
        data = b"".join([keep_alive.tick(now_ns) for keep_alive in self._keep_alives])
        self.deadline_ns = min([keep_alive.due_ns for keep_alive in self._keep_alives], default=Protocol.deadline_ns)
        return data

    def _answering(self, message: Message) -> Message:
        echo = self._echoes.get(len(message.pwm_us))
        return echo.answering(message) if echo and isinstance(message, ThrusterTelemetry) else message

    def _finish(self, form: Form, packed: bytes) -> bytes:
        """Return the bytes for the wire: with prefix, checksum, tail and stuffing."""
        trailer = self._trailer
        checksum = trailer.update(packed[form.covered], form.checksum)
        frame = form.prefix + packed + trailer.stored.pack(checksum) + trailer.tail
        return self._stuffer.wrap(frame) if self._stuffer else frame

    def _other_forms(self, other: Other) -> list[Form]:
        """Return one form, or one for each number of thrusters if the message counts them."""
        counts = range(1, MAX_THRUSTERS + 1) if any(field.name == "count" for field in other.fields) else range(1)
        return [Form(self.layout, other, None, channels, self._trailer) for channels in counts]

    def _open_reader(self, commands: list[Form], reports: list[Form], others: list[tuple[Other, list[Form]]]) -> Reader:
        """Return the reader: for both messages, to skip our own echo; without an id only for the other end's."""
        has_id = any(field.name == "id" for field in self.layout.header)
        forms = [] if self.role == "host" and not has_id else list(commands)
        forms += [] if self.role == "device" and not has_id else reports
        forms += [form for other, its_forms in others if other.sent_by != self.role for form in its_forms]
        if self._stuffer:
            from hil.links.frame.stuffing import StuffedReader

            return StuffedReader(self._stuffer, forms, self._trailer, self.counters)
        return SyncReader(self.layout, forms, self._trailer, self.counters)

    def _open_keep_alives(self, others: list[tuple[Other, list[Form]]], channels: int) -> list["KeepAlive"]:
        sent_here = [row for row in others if row[0].period and self.role and row[0].sent_by in ("both", self.role)]
        if not sent_here:
            return []
        from hil.links.frame.ends import KeepAlive

        data = [self._unchanging(forms[min(channels, len(forms)) - 1]) for _, forms in sent_here]
        return [KeepAlive(other, frame) for (other, _), frame in zip(sent_here, data, strict=True)]

    def _unchanging(self, form: Form) -> bytes:
        return self._finish(form, form.body.packer.pack(*form.body.template))

    def _open_echoes(self, commands: list[Form], reports: list[Form]) -> dict[int, "Echo"]:
        """Return the echoes by number of channels; none if the frame carries the whole sequence number."""
        bits = self.layout.sequence_bits
        if self.role != "host" or bits >= 16:
            return {}
        from hil.links.frame.ends import Echo

        answers = {form.channels: form for form in reports}
        return {
            form.channels: Echo(form, answers[form.channels], bits) for form in commands if form.channels in answers
        }


class _Compiled(NamedTuple):
    """A compiled frame file; immutable."""

    layout: FrameLayout
    trailer: Trailer
    commands: list[Form]
    reports: list[Form]


_compiled: dict[tuple[str, int, int], _Compiled] = {}


def _compile(path: str) -> _Compiled:
    """Return the compiled file at `path`; both ends of a link in one process share it. Raises ConfigError."""
    try:
        status = os.stat(path)
        key = (path, status.st_mtime_ns, status.st_size)
    except OSError:  # `load_layout` reports it
        key = (path, 0, 0)
    if key not in _compiled:
        layout = load_layout(path)
        trailer = Trailer(layout)
        commands = _forms(layout, layout.command, ThrusterCommand, trailer)
        _compiled[key] = _Compiled(
            layout, trailer, commands, _forms(layout, layout.telemetry, ThrusterTelemetry, trailer)
        )
    return _compiled[key]


def _forms(layout: FrameLayout, message: MessageLayout, kind: Kind, trailer: Trailer) -> list[Form]:
    only = next(field.channels for field in message.fields if field.name == "pwm_us")
    counts = range(only, only + 1) if only else range(1, MAX_THRUSTERS + 1)
    return [Form(layout, message, kind, channels, trailer) for channels in counts]


def _stuffer(layout: FrameLayout) -> "Stuffer | None":
    if layout.stuffing.type == "none":
        return None
    from hil.links.frame.stuffing import open_stuffer

    return open_stuffer(layout.stuffing)


def open_frame(role: Role, channels: int, frame: str = "uuv_hil") -> FrameProtocol:
    """Return one end's protocol for a frame, by preset name or path of a TOML file.

    Raises ConfigError if the frame cannot carry this number of thrusters.
    """
    protocol = FrameProtocol(find_preset("firmware_stub/frames", frame), role, channels)
    if channels not in protocol.channels:
        carried = " to ".join(map(str, sorted({protocol.channels[0], protocol.channels[-1]})))
        raise ConfigError(f"frame {frame} carries {carried} thrusters, not {channels}")
    return protocol
