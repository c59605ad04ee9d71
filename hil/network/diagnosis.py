"""Find out why nothing answers at an endpoint, which a zenoh session does not report."""

import os
import socket
import ssl
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

from hil.common.endpoint import LAN, split_endpoint
from hil.network.security import CA, CERTIFICATE, KEY

if TYPE_CHECKING:
    from hil.network.session import Session

TIMEOUT_S = 2.0
# A TLS listener has a queue for one connection (hil.network.sockets): a second one gets no answer and has to retry.
ATTEMPTS_S = (0.25, 0.25, 0.25, 0.25, 1.0)

# Codes of X509_verify_cert about the other side's certificate.
_EXPIRED, _NOT_FOR_THIS_HOST = 10, (62, 64)


class Fault(NamedTuple):
    """A fault with its remedy. `lasting`: waiting does not help."""

    text: str
    lasting: bool


def why_not(endpoint: str, folder: str = "", routed: bool = False, session: "Session | None" = None) -> Fault | None:
    """Connect as a session does, and return what is wrong; `folder` has the certificates, "" without TLS.

    The endpoint is a slave's, or a router's if `routed`. Return None if it answers, or if `session` has its links
    there; then the node is missing, or the right to listen. Raises NetworkError for an invalid endpoint.
    """
    if endpoint == LAN:
        from hil.network.discovery import NOBODY, find

        return None if (session and session.links()) or find(TIMEOUT_S) else Fault(NOBODY, False)
    _, host, port = split_endpoint(endpoint)
    if session and has_connected(session, port) and (routed or has_connected(session, port + 1)):
        return None
    host = host.strip("[]")
    try:
        connection = _connect(host, port)
    except OSError as error:
        return Fault(_unreachable(error, host, port, "router" if routed else "slave"), False)
    with connection:
        fault = _with_certificate(connection, host, folder) if folder else _without(connection)
    return fault if fault or routed else _second(host, port + 1)


def has_connected(session: "Session", port: int) -> bool:
    """Return whether the session has a link that it has opened to this `port` of any peer."""
    return any(to.partition("?")[0].endswith(f":{port}") for _, _, to in session.links())


def _connect(host: str, port: int) -> socket.socket:
    """Return a connection whose reads wait up to TIMEOUT_S. Raises OSError."""
    for seconds in ATTEMPTS_S:
        with suppress(TimeoutError):
            connection = socket.create_connection((host, port), seconds)
            connection.settimeout(TIMEOUT_S)
            return connection
    raise TimeoutError


def _second(host: str, port: int) -> Fault | None:
    """Return what is wrong with the port of a slave's second link (`hil.network.settings`); a router has none."""
    try:
        _connect(host, port).close()
    except ConnectionRefusedError:
        return Fault(
            f'it answers on port {port - 1} alone, as a router does: reach that with [network] mode = "routed" in the '
            "scenario, in Python with routed=True; it shows the vehicles that have connected to it",
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
    except TimeoutError:
        return Fault(f"{host} does not answer a TLS handshake within {TIMEOUT_S:g} s: is it busy?", False)
    except OSError:  # connection closed; a TLS peer would have answered
        return Fault(f"{host} answers without TLS: its scenario has no [security] section, and this one has", True)
    return None


def _without(connection: socket.socket) -> Fault | None:
    """Return a fault if the other side expects TLS although we have no certificate."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE  # no data is sent; the handshake only tests for TLS
    try:
        _shake(context, connection, "")
    except ssl.SSLError as error:
        error_asks = _is_alert(error)
    except OSError:
        error_asks = False
    else:
        error_asks = True
    if error_asks:
        return Fault("it wants a certificate: give this scenario its [security] section (`uuv-hil keys --help`)", True)
    return None


def _shake(context: ssl.SSLContext, connection: socket.socket, host: str) -> None:
    """Do the TLS handshake, then wait for a refusal of our certificate, which comes after it (RFC 8446, 4.4).

    A peer that accepts us waits for our first message, and closes the connection after its own timeout.
    """
    with context.wrap_socket(connection, server_hostname=host or None) as secure:
        try:
            secure.recv(1)
        except OSError as error:
            if isinstance(error, ssl.SSLError) and _is_alert(error):
                raise


def _is_alert(error: ssl.SSLError) -> bool:
    return "ALERT" in (error.reason or "")


def _their_certificate(error: ssl.SSLCertVerificationError, host: str, folder: str) -> str:
    if error.verify_code in _NOT_FOR_THIS_HOST:
        return (
            f"its certificate is not made for {host!r}: make it again with `uuv-hil keys add NAME --host {host}`, "
            "or connect to it by another address"
        )
    if error.verify_code == _EXPIRED:
        return "its certificate has expired: make it again with `uuv-hil keys add`"
    return f"its certificate is not of the authority in {folder}/{CA} ({error.verify_message})"


def _our_certificate(error: ssl.SSLError, folder: str) -> str:
    path, reason = os.path.join(folder, CERTIFICATE), error.reason or ""
    if "EXPIRED" in reason:
        return f"our certificate has expired there: make {path} again with `uuv-hil keys add`"
    alert = reason.partition("ALERT_")[2].replace("_", " ").lower()
    return f"it refuses our certificate {path} ({alert}): is it of the same authority? `uuv-hil keys add` makes it"
