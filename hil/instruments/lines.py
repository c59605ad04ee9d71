"""An instrument whose clients send lines of text."""

from abc import abstractmethod
from typing import Any

from hil.instruments.contract import Client, Facts, Instrument, Scene, Send


class LineInstrument(Instrument):
    """Joins the pieces of each client, and hands on each line; of one without an end the last `longest` bytes count."""

    longest = 256

    def __init__(self, settings: Any, facts: Facts, scene: Scene, send: Send) -> None:
        super().__init__(settings, facts, scene, send)
        self._rests: dict[Client, bytes] = {}

    def disconnected(self, client: Client, now_ns: int) -> None:
        """Forget a client."""
        self._rests.pop(client, None)

    def on_data(self, client: Client, data: bytes, now_ns: int) -> None:
        """Hand on each line that is complete."""
        *lines, rest = (self._rests.get(client, b"") + data).replace(b"\r", b"\n").split(b"\n")
        self._rests[client] = rest[-self.longest :]
        for line in filter(None, lines):
            self.on_line(client, line, now_ns)

    @abstractmethod
    def on_line(self, client: Client, line: bytes, now_ns: int) -> None:
        """Carry out a line, which has no end and is not empty. Never raises."""
