"""The key with which packets are signed: that of the scenario, or one that a ground station sets (SETUP_SIGNING).

A key travels in clear, so it is taken from this machine and its wires alone, while disarmed, and never in place of
the scenario's. It is stored with the parameters, for its owner alone, and used again at the next start; a key of zeros
ends signing. Who has lost the key removes the file. Source: mavlink.io, guide/message_signing.
"""

import os
from contextlib import suppress

from hil.links.mavlink.stream import signing_secret

SECRET_SIZE = 32


class SigningKey:
    """`secret` is the key in use, empty without one. `given` is the scenario's, `path` the file ("": none)."""

    def __init__(self, path: str = "", given: str = "") -> None:
        self._path, self.is_given = path, bool(given)
        self.secret = signing_secret(given) if given else self._load()

    def refusal(self, is_local: bool, armed: bool) -> str:
        """Return why a ground station may not set the key; "" if it may."""
        if self.is_given:
            return "signing: the key is the scenario's"
        if not is_local:
            return "signing: a key is taken from this machine alone"
        return "signing: no key is taken while armed" if armed else ""

    def set(self, secret: bytes) -> str:
        """Use and store another key; return why it could not be stored, "" if it was."""
        self.secret = secret if any(secret) else b""
        if not self._path:
            return ""
        try:
            if not self.secret:
                with suppress(FileNotFoundError):
                    os.unlink(self._path)
                return ""
            os.makedirs(os.path.dirname(self._path) or ".", exist_ok=True)
            new = f"{self._path}.{os.getpid()}"
            with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as file:
                file.write(self.secret.hex())
            os.replace(new, self._path)
        except OSError as error:
            return f"signing: not stored: {error.strerror}"
        return ""

    def _load(self) -> bytes:
        """Return the stored key; empty where there is none, or none that can be read."""
        if not self._path:
            return b""
        try:
            with open(self._path, encoding="ascii") as file:
                secret = bytes.fromhex(file.read(2 * SECRET_SIZE + 1))
        except (OSError, ValueError):
            return b""
        return secret if len(secret) == SECRET_SIZE else b""
