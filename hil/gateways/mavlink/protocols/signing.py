"""The key with which packets are signed: that of the scenario, or one that a ground station sets (SETUP_SIGNING).

A key travels in clear, so it is taken from this machine and its wires alone, while disarmed, and never in place of
the scenario's. It is stored with the parameters, for its owner alone, and used again at the next start; a key of zeros
ends signing. Who has lost the key removes the file. Source: mavlink.io, guide/message_signing.

Beside it lie the newest timestamps of all senders: what was accepted before a restart is refused after it.
"""

import hashlib
import os
from contextlib import suppress

from hil.common.tables import PRIVATE, write_atomically
from hil.links.mavlink.stream import Stamps, signing_secret

SECRET_SIZE = 32
RESERVE = 1_000_000  # units of a timestamp, 10 s: what is saved is that much newer, so that it is rarely saved


class SavedStamps(Stamps):
    """Timestamps of senders with the key `secret`, in the file `path` ("": none). After a crash 10 s more are refused.

    A file that cannot be written changes nothing for the packets: they are accepted, and not known after a restart.
    """

    def __init__(self, path: str, secret: bytes) -> None:
        super().__init__()
        self._path = path if secret else ""
        self._key = hashlib.sha256(secret).hexdigest()[:16]
        self._load()
        self._saved = dict(self.newest)

    def accept(self, sender: tuple[int, int, int], timestamp: int, own: int) -> bool:
        """Return whether a packet is newer than all before, also than those before a restart."""
        if not super().accept(sender, timestamp, own):
            return False
        if self._path and timestamp > self._saved.get(sender, -1):
            self._saved[sender] = timestamp + RESERVE
            self._save(self._saved)
        return True

    def close(self) -> None:
        """Save the timestamps as they are."""
        if self._path and self.newest:
            self._save(self.newest)

    def _save(self, stamps: dict[tuple[int, int, int], int]) -> None:
        rows = [f"{link} {system} {component} {stamp}" for (link, system, component), stamp in stamps.items()]
        with suppress(OSError):
            write_atomically(self._path, "\n".join([self._key, *rows]), PRIVATE)

    def _load(self) -> None:
        """Read the stamps of this key; other keys' and damaged ones are none."""
        with suppress(OSError, ValueError):
            with open(self._path, encoding="ascii") as file:
                key, *rows = file.read().splitlines()
            for row in rows if key == self._key else ():
                link, system, component, stamp = map(int, row.split())
                self.newest[link, system, component] = stamp


class SigningKey:
    """`secret` is the key in use, empty without one; `stamps` what was received with it.

    `given` is the scenario's key, `path` the file of one that a ground station set ("": none).
    """

    def __init__(self, path: str = "", given: str = "") -> None:
        self._path, self.is_given = path, bool(given)
        self.secret = signing_secret(given) if given else self._load()
        self.stamps = self._stamps()

    def close(self) -> None:
        """Save what has to be known at the next start."""
        self.stamps.close()

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
        self.stamps = self._stamps()
        if not self._path:
            return ""
        try:
            if not self.secret:
                with suppress(FileNotFoundError):
                    os.unlink(self._path)
                return ""
            write_atomically(self._path, self.secret.hex(), PRIVATE)
        except OSError as error:
            return f"signing: not stored: {error.strerror}"
        return ""

    def _stamps(self) -> SavedStamps:
        return SavedStamps(f"{self._path}.stamps" if self._path else "", self.secret)

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
