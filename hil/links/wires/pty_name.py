"""A name for a pseudo terminal that stays the same from run to run."""

import fcntl
import os

from hil.common.errors import DeviceError


class PtyName:
    """Symbolic link `path` to the pty `target`; a lock file beside it ensures that at most one process owns it.

    Raises DeviceError if another process owns it, it cannot be made, or `path` is something else.
    """

    def __init__(self, path: str, target: str) -> None:
        self._path, self._target = path, target
        self._lock_path = f"{path}.lock"
        try:
            self._lock = self._acquire_lock()
        except OSError as error:
            raise DeviceError(f"{path}: cannot be made: {error.strerror}; choose another device path") from None
        try:
            self._publish()
        except DeviceError:
            self._release()
            raise

    def remove(self) -> None:
        """Remove the link if it is still ours, and the lock file."""
        if os.path.islink(self._path) and os.readlink(self._path) == self._target:
            os.unlink(self._path)
        self._release()

    def _acquire_lock(self) -> int:
        while True:
            fd = os.open(self._lock_path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
            try:
                fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(fd)
                raise DeviceError(
                    f"{self._path}: already served by another process; end that one or choose another device path"
                ) from None
            if _is_still(fd, self._lock_path):
                return fd
            os.close(fd)  # the owner removed the file between our open and our lock, so this lock protects nothing

    def _publish(self) -> None:
        path, fresh = self._path, f"{self._path}.new"
        if os.path.lexists(path) and not _links_to_pty(path):
            raise DeviceError(f"{path}: exists and is not a link to a pty; remove it or choose another device path")
        try:
            if os.path.islink(fresh):  # left over by a process that was killed here
                os.unlink(fresh)
            os.symlink(self._target, fresh)
            os.replace(fresh, path)
        except OSError as error:
            raise DeviceError(f"{path}: cannot be made: {error.strerror}; choose another device path") from None

    def _release(self) -> None:
        if _is_still(self._lock, self._lock_path):  # someone may have cleaned up /tmp
            # Before the lock is released, so that nobody can lock a file that is being removed.
            os.unlink(self._lock_path)
        os.close(self._lock)


def _is_still(fd: int, path: str) -> bool:
    try:
        return os.path.samestat(os.fstat(fd), os.stat(path))
    except FileNotFoundError:
        return False


def _links_to_pty(path: str) -> bool:
    return os.path.islink(path) and os.readlink(path).startswith("/dev/pts/")
