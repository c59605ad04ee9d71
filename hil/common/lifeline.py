"""End this process when its parent ends, whatever ends that: the child's side of hil.common.children.

    python -I -S hil/common/lifeline.py PROGRAM [ARGUMENT ...]      run another program so

A command loads this file first, for Ctrl-C before it runs (`leave_on_ctrl_c`): what is loaded earlier Ctrl-C can hit.

The child holds the read end of a pipe (the lifeline) whose only write end is in its parent. It asks the kernel for a
SIGKILL when that end closes, as it does when the parent has ended: O_ASYNC, F_SETOWN and F_SETSIG of fcntl(2). Then it
looks whether the pipe is at its end already, so that no moment is left open. An exec keeps all of it.

This is not PR_SET_PDEATHSIG: that follows the thread that started the child, and links are opened again by threads
that then end; it is lost where a program changes its user; and it needs ctypes, which costs a slave's start-up.
"""

import os
import signal
import sys

NO_PROGRAM = 127  # the exit code, as of a shell
VARIABLE = "UUV_HIL_LIFELINE"  # in the child's environment: the number of the pipe's read end, a colon, and its inode


TYPE_CHECKING = False  # as typing has it, which takes a while to load
if TYPE_CHECKING:
    from types import FrameType
    from typing import NoReturn


def leave_on_ctrl_c() -> None:
    """End the process at Ctrl-C, at once and without a word: so early there is nothing to bring to an end."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # it may be ignored, as by nohup
        signal.signal(signal.SIGINT, _leave)


def raise_on_ctrl_c() -> None:
    """End what `leave_on_ctrl_c` began: Ctrl-C raises KeyboardInterrupt again."""
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _leave(_number: int, _frame: "FrameType | None") -> "NoReturn":
    os._exit(130)  # STOPPED of hil.common.errors, which a file that is run by its path cannot import


def die_with_parent() -> None:
    """Let SIGKILL end this process when its parent ends, if that is one of ours. To be called first of all.

    In a process group of its own the whole group ends. Without a lifeline nothing happens.
    """
    number, _, inode = os.environ.pop(VARIABLE, "").partition(":")  # what this process starts has no such descriptor
    try:
        if os.fstat(int(number)).st_ino == int(inode):
            tie(int(number))
    except (OSError, ValueError, OverflowError):  # none, or a program in between has closed it
        return


def describe_end(number: int, descriptor: int) -> str:
    """Return the text of VARIABLE for a child that inherits this descriptor under that number."""
    return f"{number}:{os.fstat(descriptor).st_ino}"


def tie(lifeline: int) -> None:
    """Let SIGKILL end this process, or its group if it leads one, when the write end of this pipe is closed.

    Raises OSError if the descriptor is not open.
    """
    import fcntl  # not on Windows, where nothing of ours is started with a lifeline

    fcntl.fcntl(lifeline, fcntl.F_SETOWN, -os.getpid() if os.getpgrp() == os.getpid() else os.getpid())
    fcntl.fcntl(lifeline, fcntl.F_SETSIG, signal.SIGKILL)
    fcntl.fcntl(lifeline, fcntl.F_SETFL, fcntl.fcntl(lifeline, fcntl.F_GETFL) | os.O_ASYNC | os.O_NONBLOCK)
    try:
        if os.read(lifeline, 1) == b"":  # it was closed before the kernel had our wish
            os.kill(os.getpid(), signal.SIGKILL)
    except BlockingIOError:
        return


def die_with(path: str) -> None:
    """Let SIGKILL end this process when the one ends whose lifeline is at `path`, as /proc names its descriptors.

    For workers of a library, which hands no descriptors on; they are of the same user, as `path` is else not to be
    opened, and then nothing happens.
    """
    try:
        tie(os.open(path, os.O_RDONLY | os.O_NONBLOCK))
    except FileNotFoundError:  # it has ended meanwhile
        os.kill(os.getpid(), signal.SIGKILL)
    except OSError:
        return


def main(command: list[str]) -> None:
    """Replace this process by another program, which ends with the parent; exit with NO_PROGRAM if there is none."""
    die_with_parent()
    for ignored in (signal.SIGPIPE, signal.SIGXFSZ):  # by the interpreter, which would be inherited
        signal.signal(ignored, signal.SIG_DFL)
    try:
        os.execvp(command[0], command)
    except OSError as error:
        print(f"{command[0]}: cannot be started: {error.strerror}", file=sys.stderr)
        sys.exit(NO_PROGRAM)


if __name__ == "__main__":
    main(sys.argv[1:])
