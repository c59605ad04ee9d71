"""Open endpoints, and open them again when they are lost."""

import errno
import threading
from collections.abc import Callable

from hil.common.errors import DeviceError, HilError, NetworkError
from hil.links.endpoints.lines import PtyLink, SerialLink, UartPtyLink
from hil.links.endpoints.sockets import RETRY_NS, SILENT_NS, Address, Link, Received, TcpIn, TcpOut, UdpIn, UdpOut

FIRST_S = 0.5  # how long the start waits for an endpoint: the others must not wait for its name server
FATAL = {errno.EADDRINUSE, errno.EACCES, errno.EPERM}  # these do not pass by waiting
KINDS: dict[str, Callable[[str, int], Link]] = {
    "udpout": UdpOut, "tcpout": TcpOut, "serial": SerialLink, "pty": PtyLink,
}  # fmt: skip


def open_endpoint(
    kind: str,
    target: str,
    port: int,
    report: Callable[[str], None],
    first: bytes = b"",
    silent_ns: int = SILENT_NS,
    automatic: bytes | None = None,
) -> "PatientLink":
    """Return an endpoint that opens, now or as soon as it can, of one of `KINDS`, "udpin" or "tcpin".

    `target` is a host or a device, `port` for a line its speed in bit/s; `first` as for `Link`. A partner by datagrams
    is forgotten after `silent_ns`. With `automatic` a pty is a `UartPtyLink`. Raises NetworkError if it cannot be
    opened by waiting.
    """

    def opener() -> Link:
        if kind == "udpin":
            return UdpIn(target, port, first, silent_ns)
        if kind == "pty" and automatic is not None:
            return UartPtyLink(target, port, automatic)
        return TcpIn(target, port, first) if kind == "tcpin" else KINDS[kind](target, port)

    return PatientLink(f"{kind}:{target}:{port}", opener, report)


class PatientLink(Link):
    """An endpoint that a thread opens, again when it is lost: addresses and devices come late, change and go.

    The wait for it, and its end, are reported once. Raises NetworkError for a fault that does not pass, such as a taken
    port.
    """

    def __init__(self, name: str, opener: Callable[[], Link], report: Callable[[str], None]) -> None:
        self.name = name
        self._open, self._report = opener, report
        self._link: Link | None = None
        self._result: Link | OSError | HilError | None = None
        self._due_ns = 0
        self._has_waited = False
        self._baud = 0  # that was set
        self._thread = threading.Thread(target=self._try, daemon=True)
        self._thread.start()
        self._thread.join(FIRST_S)
        if isinstance(self._result, OSError) and self._result.errno in FATAL:
            raise NetworkError(f"{name}: {self._result.strerror}; choose another endpoint")
        self._take(0)

    def descriptors(self) -> list[int]:
        """Return what to wait on."""
        return self._link.descriptors() if self._link else []

    def receive(self, now: int) -> Received:
        """Return the bytes received, with the address of each sender."""
        return self._link.receive(now) if self._link else []

    def send(self, address: Address, data: bytes) -> None:
        """Send a packet, if the endpoint is open."""
        if self._link:
            self._link.send(address, data)

    def partners(self) -> list[Address]:
        """Return the present partners."""
        return self._link.partners() if self._link else []

    def is_local(self, address: Address) -> bool:
        """Return whether a partner is on this machine, or on a wire of it."""
        return self._link.is_local(address) if self._link else super().is_local(address)

    def set_baud(self, baud: int) -> None:
        """Change the speed of a line, also of one that opens later."""
        self._baud = baud
        if self._link:
            self._link.set_baud(baud)

    def tick(self, now: int) -> None:
        """Open the endpoint again if it was lost."""
        if self._link:
            self._link.tick(now)
            self.refused, self._link.refused = self.refused + self._link.refused, 0
            if self._link.is_lost:
                self._link.close()
                self._link, self._due_ns = None, now
        elif self._thread.is_alive():
            self._wait("no answer yet")
        elif self._result:
            self._take(now)
        elif now >= self._due_ns:
            self._thread = threading.Thread(target=self._try, daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Close it; a thread that still opens it ends with the process."""
        if self._link:
            self._link.close()

    def _try(self) -> None:
        try:
            self._result = self._open()
        except (OSError, DeviceError) as error:
            self._result = error

    def _take(self, now: int) -> None:
        """Use what the thread has opened, or try again later."""
        result, self._result = self._result, None
        if isinstance(result, Link):
            self._link, self.burst = result, result.burst
            if self._baud:
                result.set_baud(self._baud)
            if self._has_waited:
                self._report(f"{self.name}: is open")
            self._has_waited = False
        elif result:
            self._due_ns = now + RETRY_NS
            self._wait(str(getattr(result, "strerror", None) or result).removeprefix(f"{self.name}: "))

    def _wait(self, why: str) -> None:
        if not self._has_waited:
            self._has_waited = True
            self._report(f"{self.name}: waiting for it: {why}")
