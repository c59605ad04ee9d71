"""End this process when its parent ends, for whatever reason: the child's side of hil.common.children.

    python -I -S hil/common/lifeline.py PROGRAM [ARGUMENT ...]      run another program this way

Every command imports this file first, for its handling of an early Ctrl-C (`leave_on_ctrl_c`).

The child holds the read end of a pipe (the lifeline); only the parent holds the write end. The child asks the kernel
for a SIGKILL when the write end closes, which happens when the parent ends: O_ASYNC, F_SETOWN and F_SETSIG of fcntl(2).
Then it checks whether the pipe is closed already, so that no gap is left. All this survives an exec.

PR_SET_PDEATHSIG would not do: it follows the thread that started the child, and our links are reopened by threads that
end afterwards. It is also lost when a program changes its user, and needs ctypes, which lengthens a slave's start.
"""

import os
import signal
import sys

NO_PROGRAM = 127  # exit code, the same as of a shell
VARIABLE = "UUV_HIL_LIFELINE"  # in the child's environment: number of the pipe's read end, a colon, its inode


TYPE_CHECKING = False  # instead of the import from typing, which is slow
if TYPE_CHECKING:
    from types import FrameType
    from typing import NoReturn


def leave_on_ctrl_c() -> None:
    """End the process silently and at once on Ctrl-C; this early there is nothing to clean up."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # keep it ignored, for example under nohup
        signal.signal(signal.SIGINT, _leave)


def raise_on_ctrl_c() -> None:
    """Undo `leave_on_ctrl_c`: Ctrl-C raises KeyboardInterrupt again."""
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _leave(_number: int, _frame: "FrameType | None") -> "NoReturn":
    os._exit(130)  # STOPPED of hil.common.errors; a file run by its path cannot import that


def die_with_parent() -> None:
    """Let SIGKILL end this process when its parent, one of ours, ends. Call this before anything else.

    A process that leads a process group ends with its whole group. Without a lifeline this does nothing.
    """
    number, _, inode = os.environ.pop(VARIABLE, "").partition(":")  # removed: our own children lack this descriptor
    try:
        if os.fstat(int(number)).st_ino == int(inode):
            tie(int(number))
    except (OSError, ValueError, OverflowError):  # no lifeline, or a program in between has closed it
        return


def describe_end(number: int, descriptor: int) -> str:
    """Return the text of VARIABLE for a child that inherits this descriptor under that number."""
    return f"{number}:{os.fstat(descriptor).st_ino}"


def tie(lifeline: int) -> None:
    """Let SIGKILL end this process, or its group if it leads one, when the write end of this pipe is closed.

    Raises OSError if the descriptor is not open.
    """
    import fcntl  # not on Windows, where lifelines are not used

    fcntl.fcntl(lifeline, fcntl.F_SETOWN, -os.getpid() if os.getpgrp() == os.getpid() else os.getpid())
    fcntl.fcntl(lifeline, fcntl.F_SETSIG, signal.SIGKILL)
    fcntl.fcntl(lifeline, fcntl.F_SETFL, fcntl.fcntl(lifeline, fcntl.F_GETFL) | os.O_ASYNC | os.O_NONBLOCK)
    try:
        if os.read(lifeline, 1) == b"":  # closed before the kernel got our request
            os.kill(os.getpid(), signal.SIGKILL)
    except BlockingIOError:
        return


def die_with(path: str) -> None:
    """Let SIGKILL end this process when the process with the lifeline at `path` (/proc/PID/fd/N) ends.

    For workers that a library starts without inheriting descriptors. They have to run as the same user; otherwise
    `path` cannot be opened, and this does nothing.
    """
    try:
        tie(os.open(path, os.O_RDONLY | os.O_NONBLOCK))
    except FileNotFoundError:  # that process has ended already
        os.kill(os.getpid(), signal.SIGKILL)
    except OSError:
        return


def main(command: list[str]) -> None:
    """Replace this process by another program, which ends with the parent; exit with NO_PROGRAM if it is not found."""
    die_with_parent()
    for ignored in (signal.SIGPIPE, signal.SIGXFSZ):  # the interpreter ignores them, and an exec would keep that
        signal.signal(ignored, signal.SIG_DFL)
    try:
        os.execvp(command[0], command)
    except OSError as error:
        print(f"{command[0]}: cannot be started: {error.strerror}", file=sys.stderr)
        sys.exit(NO_PROGRAM)


if __name__ == "__main__":
    main(sys.argv[1:])
