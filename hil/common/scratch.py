"""Temporary folders. They are removed on close; those of a killed process when the next one is made.

Each folder is locked by its user. The kernel releases the lock when that process ends, however it ends. So a folder
that can be locked is abandoned, and the next process that makes a folder removes it. A process id would not show this.
On Windows folders can be neither opened nor locked, so those of a killed process stay.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import suppress

from hil.common.errors import DeviceError
from hil.common.tables import forget_parsed

PREFIX = "uuv-hil-scratch-"
CLOSED, NOT_LOCKED = -1, -2


class ScratchFolder:
    """A new folder that only this user can read, with `purpose` in its name; `path` is valid until `close`.

    It is made in `base`, by default the folder for temporary files. Abandoned folders of this user in `base` are
    removed. Removal also clears the cache of the scenario files in the folder. Raises DeviceError if it cannot be made.
    """

    def __init__(self, purpose: str, base: str = "") -> None:
        import tempfile  # not needed by a slave in most scenarios

        base = base or tempfile.gettempdir()
        can_lock = sys.platform != "win32"
        for name in _names(base) if can_lock else ():
            _remove_abandoned(os.path.join(base, name))
        while True:
            try:
                self.path = tempfile.mkdtemp(prefix=f"{PREFIX}{purpose}-", dir=base)
            except OSError as error:
                remedy = "free some space, or choose another folder with TMPDIR"
                raise DeviceError(f"{base}: no folder can be made: {error.strerror}; {remedy}") from None
            if not can_lock:
                self._lock = NOT_LOCKED
                return
            with suppress(FileNotFoundError):  # removed as abandoned by another process before it was opened
                self._lock = os.open(self.path, os.O_RDONLY | os.O_DIRECTORY)
                _lock(self._lock, wait=True)
                if os.path.exists(self.path):  # else it was removed before it was locked
                    return
                os.close(self._lock)

    def __enter__(self) -> "ScratchFolder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def file(self, name: str) -> str:
        """Return the path of a file in it."""
        return os.path.join(self.path, name)

    def close(self) -> None:
        """Remove the folder with its content. May be called twice."""
        if self._lock != CLOSED:
            _remove(self.path)
            if self._lock != NOT_LOCKED:
                os.close(self._lock)
            self._lock = CLOSED


def lock_unused(path: str) -> int | None:
    """Lock a folder of this user and return its descriptor, to be closed by the caller; None if it is locked already.

    Raises OSError if it cannot be opened or is not a folder.
    """
    folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        _lock(folder, wait=False)
        if os.fstat(folder).st_uid == os.geteuid():
            return folder
    except BlockingIOError:
        pass
    os.close(folder)
    return None


def _names(base: str) -> Iterator[str]:
    with suppress(OSError):
        yield from [name for name in os.listdir(base) if name.startswith(PREFIX)]


def _remove_abandoned(path: str) -> None:
    with suppress(OSError):  # already removed, or owned by another user
        folder = lock_unused(path)
        if folder is not None:
            _remove(path)
            os.close(folder)


def _remove(path: str) -> None:
    import shutil

    forget_parsed(path)
    shutil.rmtree(path, ignore_errors=True)


def _lock(folder: int, wait: bool) -> None:
    """Lock the folder. Without `wait`, raises BlockingIOError if another process has locked it."""
    import fcntl  # not on Windows, where this file has to be importable too

    fcntl.flock(folder, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
