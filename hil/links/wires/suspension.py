"""Discard what waited on a wire while its reader was suspended, because a real STM32 would not have stored it."""

from hil.common.clock import now_ns
from hil.links.contract import Counters, Wire


class SuspendableWire(Wire):
    """`wire`, which it owns, without the bytes that may have waited for longer than `limit_ns`.

    So a process that was stopped and continued, or did not get the processor, executes no old command. The reader calls
    `read` more often than that. `counters` counts the discarded bytes. Raises the errors of `wire`.
    """

    def __init__(self, wire: Wire, limit_ns: int, counters: Counters) -> None:
        self.name = wire.name
        self.record_size = wire.record_size
        self._wire = wire
        self._limit_ns = limit_ns
        self._counters = counters
        self._read_ns = now_ns()

    def fileno(self) -> int:
        """Return the descriptor to wait on for incoming bytes; -1 once closed."""
        return self._wire.fileno()

    def read(self) -> bytes:
        """Return the received bytes; b"" after discarding them if the last read was too long ago."""
        # The time is taken after the read: a pause between the two would hide how old the bytes are.
        data, now = self._wire.read(), now_ns()
        if now - self._read_ns > self._limit_ns:
            self._counters.dropped_bytes += len(data) + self._wire.discard_received()
            data = b""
        self._read_ns = now
        return data

    def discard_received(self) -> int:
        """Discard all that arrived and was not read; return how many bytes."""
        return self._wire.discard_received()

    def write(self, data: bytes) -> int:
        """Write `data`; return the number of bytes accepted."""
        return self._wire.write(data)

    def unsent(self) -> int:
        """Return how many accepted bytes are not sent yet."""
        return self._wire.unsent()

    def discard_unsent(self) -> None:
        """Discard the bytes that `unsent` counts."""
        self._wire.discard_unsent()

    def fault_counts(self) -> tuple[dict[str, float], dict[str, float]]:
        """Return the counters of the injected faults of `wire`."""
        return self._wire.fault_counts()

    def close(self) -> None:
        """Close the wire. May be called twice."""
        self._wire.close()
