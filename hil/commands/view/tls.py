"""TLS for the page of the live view."""

import os
from ipaddress import ip_address
from ssl import PROTOCOL_TLS_SERVER, SSLContext, SSLError

from hil.common.errors import ConfigError
from hil.network.security import CERTIFICATE, KEY


def is_local(host: str) -> bool:
    """Return True if `host` is an address that only this machine reaches."""
    try:
        return ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


def page_tls(host: str, cert: str, key: str, folder: str) -> SSLContext | None:
    """Return the TLS context of a page at `host`: from `cert` and `key`, else, beyond this machine, from `folder`.

    None without either. `folder` is one that `uuv-hil keys add NAME` made. Raises ConfigError.
    """
    if bool(cert) != bool(key):
        raise ConfigError("--cert and --key go together: a certificate, and its private key")
    if not cert and folder and not is_local(host):
        cert, key = os.path.join(folder, CERTIFICATE), os.path.join(folder, KEY)
    if not cert:
        return None
    context = SSLContext(PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(cert, key)
    except SSLError:
        raise ConfigError(f"{cert} and {key} are not a certificate and its private key, as PEM") from None
    except OSError as error:
        raise ConfigError(f"{cert} or {key} cannot be read: {error.strerror}") from None
    return context
