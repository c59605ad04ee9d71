"""Instruments whose clients send messages in any pieces: a reader for each client joins them."""

from abc import abstractmethod
from collections.abc import Iterable
from typing import Any, Protocol

from hil.instruments.contract import Client, Facts, Instrument, Scene, Send


class Reader(Protocol):
    """Finds the messages in the bytes of one client; counts in `malformed` what is none."""

    malformed: int

    def read(self, data: bytes) -> Iterable[Any]:
        """Return the messages that are complete with `data`. Never raises."""


class Lines:
    """Joins pieces to lines without their ends; of one without an end the last `longest` bytes count, in `rest`."""

    def __init__(self, longest: int) -> None:
        self.rest, self._longest = b"", longest
        self.malformed = 0

    def read(self, data: bytes) -> Iterable[bytes]:
        """Return each line that is complete, except empty ones."""
        *lines, rest = (self.rest + data).replace(b"\r", b"\n").split(b"\n")
        self.rest = rest[-self._longest :]
        return filter(None, lines)


class StreamInstrument(Instrument):
    """Hands on each message of a client."""

    def __init__(self, settings: Any, facts: Facts, scene: Scene, send: Send) -> None:
        super().__init__(settings, facts, scene, send)
        self._readers: dict[Client, Reader] = {}

    @abstractmethod
    def new_reader(self, client: Client) -> Reader:
        """Return the reader of a client."""

    @abstractmethod
    def on_message(self, client: Client, message: Any, now_ns: int) -> None:
        """Carry out a message. Never raises."""

    def connected(self, client: Client, now_ns: int) -> None:
        """Take up a client."""
        self._readers[client] = self.new_reader(client)

    def disconnected(self, client: Client, now_ns: int) -> None:
        """Forget a client."""
        self._readers.pop(client, None)

    def on_data(self, client: Client, data: bytes, now_ns: int) -> None:
        """Hand on the messages that are complete."""
        reader = self._readers[client]
        for message in reader.read(data):
            self.on_message(client, message, now_ns)
        self.malformed, reader.malformed = self.malformed + reader.malformed, 0


class LineInstrument(StreamInstrument):
    """Hands on each line, which has no end and is not empty; `longest` as for `Lines`."""

    longest = 256

    def new_reader(self, client: Client) -> Reader:
        """Return the reader of a client."""
        return Lines(self.longest)
