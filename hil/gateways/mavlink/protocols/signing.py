"""The key of the scenario, with which packets are signed, and the timestamps of packets that were accepted.

What was accepted before a restart is refused after it. Source: mavlink.io, guide/message_signing.
"""

import hashlib
from contextlib import suppress

from hil.common.tables import PRIVATE, write_atomically
from hil.links.mavlink.stream import Stamps, signing_secret

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
    """`secret` signs packets, empty: none; `stamps` are of what was received with it, saved beside `path` ("": not)."""

    def __init__(self, path: str = "", given: str = "") -> None:
        self.secret = signing_secret(given) if given else b""
        self.stamps = SavedStamps(f"{path}.stamps" if path else "", self.secret)
