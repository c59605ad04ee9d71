"""Access to a gateway: a client must send the token that the gateway made at its start.

The token is shown to the person who starts the gateway, and lies in a file that only this user can read, where
programs of the same user on the same machine find it. A web page can reach a port of this machine, but no file.
"""

import os
import secrets
from contextlib import suppress

from hil.common.tables import PRIVATE, state_path, write_atomically


def token_path(port: int) -> str:
    """Return where the token of the gateway at that port lies on this machine."""
    return state_path(f"gateway-{port}.token")


class Access:
    """A new token, and its file of mode 0600, which `close` removes.

    `path` is "" where no file can be written; the token is then only shown.
    """

    def __init__(self, port: int) -> None:
        self.token = secrets.token_urlsafe(24)
        self.path = token_path(port)
        try:
            write_atomically(self.path, self.token + "\n", PRIVATE)
        except OSError:
            self.path = ""

    def admits(self, token: object) -> bool:
        """Return whether that is the token; takes equally long whatever it is."""
        return isinstance(token, str) and secrets.compare_digest(
            token.encode(errors="surrogatepass"), self.token.encode()
        )

    def close(self) -> None:
        """Remove the file, unless another gateway has written its own there since."""
        with suppress(OSError, UnicodeDecodeError):
            with open(self.path, encoding="ascii") as file:
                own = file.read().strip() == self.token
            if own:
                os.unlink(self.path)
