"""Why nobody answers at an endpoint: what the session, which only keeps trying, does not tell."""

import os
import socket
import ssl
from contextlib import suppress
from typing import NamedTuple

from hil.transport.security import CA, CERTIFICATE, KEY
from hil.transport.settings import split

TIMEOUT_S = 2.0

# Of X509_verify_cert: what is wrong with the certificate that the other side shows.
_EXPIRED, _NOT_FOR_THIS_HOST = 10, (62, 64)


class Fault(NamedTuple):
    """What is wrong, with the remedy, and whether it stays so however long one waits."""

    text: str
    lasting: bool


def why_not(endpoint: str, folder: str = "", routed: bool = False) -> Fault | None:
    """Try to reach a slave, or if `routed` a router, as a session does, with the certificates in `folder` ("": none).

    None when all is well: then what is missing is the node, or the right to listen. Raises NetworkError when the
    endpoint cannot be meant.
    """
    _, host, port = split(endpoint)
    host = host.strip("[]")
    try:
        connection = socket.create_connection((host, port), TIMEOUT_S)
    except OSError as error:
        return Fault(_unreachable(error, host, port, "router" if routed else "slave"), False)
    with connection:
        fault = _with_certificate(connection, host, folder) if folder else _without(connection)
    return fault if fault or routed else _second(host, port + 1)


def _second(host: str, port: int) -> Fault | None:
    """What is wrong with the port of a slave's second link (`hil.transport.settings`), which a router has not."""
    try:
        socket.create_connection((host, port), TIMEOUT_S).close()
    except ConnectionRefusedError:
        return Fault(
            f'it answers on port {port - 1} alone, as a router does: reach that with [network] mode = "routed" in the '
            "scenario, in Python with routed=True; it shows the vehicles that have dialled it",
            False,
        )
    except OSError:
        return Fault(f"{host} does not answer on port {port}: a slave needs both ports open in its firewall", False)
    return None


def _unreachable(error: OSError, host: str, port: int, program: str) -> str:
    if isinstance(error, ConnectionRefusedError):
        return f"{host} is there but nothing listens on port {port}: is `uuv-hil {program}` running, with --listen?"
    if isinstance(error, socket.gaierror):
        return f"no machine is called {host!r} here; give its address"
    if isinstance(error, TimeoutError):
        return f"{host} does not answer: is it on, in this network, and port {port} open in its firewall?"
    return f"{host} cannot be reached: {error.strerror}"


def _with_certificate(connection: socket.socket, host: str, folder: str) -> Fault | None:
    context = ssl.create_default_context(cafile=os.path.join(folder, CA))
    context.load_cert_chain(os.path.join(folder, CERTIFICATE), os.path.join(folder, KEY))
    try:
        _shake(context, connection, host)
    except ssl.SSLCertVerificationError as error:
        return Fault(_their_certificate(error, host, folder), True)
    except ssl.SSLError as error:
        if _is_alert(error):
            return Fault(_our_certificate(error, folder), True)
        return Fault(f"{host} answers without TLS: its scenario has no [security] section, and this one has", True)
    except OSError:  # closed or silent: what speaks TLS answers
        return Fault(f"{host} answers without TLS: its scenario has no [security] section, and this one has", True)
    return None


def _without(connection: socket.socket) -> Fault | None:
    """Whether the other side, which we would speak to openly, wants TLS."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE  # nothing is said to it: it is only asked whether it speaks TLS
    try:
        _shake(context, connection, "")
    except ssl.SSLError as error:
        wants = _is_alert(error)
    except OSError:
        wants = False
    else:
        wants = True
    if wants:
        return Fault("it wants a certificate: give this scenario its [security] section (`uuv-hil keys --help`)", True)
    return None


def _shake(context: ssl.SSLContext, connection: socket.socket, host: str) -> None:
    """The handshake, and what follows it: a refusal of our certificate comes after our last word (RFC 8446, 4.4)."""
    with context.wrap_socket(connection, server_hostname=host or None) as secure:
        secure.settimeout(0.3)
        with suppress(TimeoutError):  # it waits for our first message: we are accepted
            secure.recv(1)


def _is_alert(error: ssl.SSLError) -> bool:
    return "ALERT" in (error.reason or "")


def _their_certificate(error: ssl.SSLCertVerificationError, host: str, folder: str) -> str:
    if error.verify_code in _NOT_FOR_THIS_HOST:
        return (
            f"its certificate is not made for {host!r}: make it again with `uuv-hil keys add NAME --host {host}`, "
            "or dial it by another address"
        )
    if error.verify_code == _EXPIRED:
        return "its certificate has expired: make it again with `uuv-hil keys add`"
    return f"its certificate is not of the authority in {folder}/{CA} ({error.verify_message})"


def _our_certificate(error: ssl.SSLError, folder: str) -> str:
    path, reason = os.path.join(folder, CERTIFICATE), error.reason or ""
    if "EXPIRED" in reason:
        return f"our certificate has expired there: make {path} again with `uuv-hil keys add`"
    said = reason.partition("ALERT_")[2].replace("_", " ").lower()
    return f"it refuses our certificate {path} ({said}): is it of the same authority? `uuv-hil keys add` makes it"
