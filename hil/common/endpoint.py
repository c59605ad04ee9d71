"""Parse endpoints: tcp/HOST:PORT, HOST:PORT or HOST."""

from hil.common.errors import NetworkError

DEFAULT_PORT = 7447
LAN = "lan"  # in place of an endpoint: search for it in the local network, see hil.network.discovery


def split_endpoint(endpoint: str) -> tuple[str, str, int]:
    """Return scheme, host and port of an endpoint: "tcp/HOST:PORT", "tls/HOST:PORT", or without scheme or port.

    The default scheme is tcp, the default port DEFAULT_PORT; an IPv6 address stands in brackets. Port 65535 is not
    allowed, because the next port is used too. Raises NetworkError for any other text.
    """
    scheme, slash, address = endpoint.partition("/")
    if not slash:
        scheme, address = "tcp", endpoint
    host, port = address, str(DEFAULT_PORT)
    if not address.endswith("]"):
        name, colon, number = address.rpartition(":")
        host, port = (name, number) if colon else (address, port)
    named = host and not host.isdigit() and not any(letter in " \t/?#" or not letter.isprintable() for letter in host)
    bare_ipv6 = ":" in host and not (host.startswith("[") and host.endswith("]"))
    number_ok = port.isascii() and port.isdigit() and len(port) <= 5 and 0 < int(port) < 65535
    if scheme not in ("tcp", "tls") or not named or bare_ipv6 or not number_ok:
        shown = endpoint if len(endpoint) <= 60 else f"{endpoint[:60]}..."
        why = "; an IPv6 address stands in brackets: tcp/[::1]:7447" if bare_ipv6 else ""
        raise NetworkError(
            f"endpoint {shown!r} is not of the form tcp/HOST:PORT, HOST:PORT or HOST, for example tcp/127.0.0.1:7447, "
            f"with a port from 1 to 65534{why}"
        )
    return scheme, host, int(port)


def no_certificates(endpoint: str) -> str:
    """Return the problem with a TLS endpoint where there are no certificates; "" for TCP. Raises NetworkError."""
    if split_endpoint(endpoint)[0] != "tls":
        return ""
    return (
        f"endpoint {endpoint!r} asks for TLS, which needs certificates: make them with `uuv-hil keys add NAME` and "
        "name them in a [security] section of the scenario, or begin it with tcp/"
    )


def validate_endpoint(key: str, endpoint: str) -> str | None:
    """Return what is wrong with the endpoint under `key` of a file; None if it is valid."""
    try:
        split_endpoint(endpoint)
    except NetworkError as error:
        return f"{key}: {error}"
    return None


def full_endpoint(endpoint: str) -> str:
    """Return an endpoint with scheme and port: "192.168.3.116" gives "tcp/192.168.3.116:7447". Raises NetworkError."""
    scheme, host, port = split_endpoint(endpoint)
    return f"{scheme}/{host}:{port}"
