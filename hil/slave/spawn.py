"""Start a program from a process with a real-time loop.

`os.posix_spawn` and `subprocess` hold the interpreter lock until the child has begun, which takes long on a busy
machine. The same call through ctypes releases the lock, so that the other threads continue.
"""

import ctypes
import os
import signal
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress

END_WITHIN_S, LOOK_S = 5.0, 0.01  # time for a program to end after SIGTERM; polling period meanwhile
_SETSID = 0x80  # POSIX_SPAWN_SETSID
_ROOM = 1024  # bytes; the structures of glibc and musl need up to 336


def spawn(arguments: Sequence[str], environment: Mapping[str, str], ends: Sequence[int]) -> int:
    """Start a program in a new session, with the descriptors `ends` as its 0, 1, 2, ...; return its pid.

    Raises OSError.
    """
    libc = ctypes.CDLL(None)
    actions, attributes = ctypes.create_string_buffer(_ROOM), ctypes.create_string_buffer(_ROOM)
    libc.posix_spawn_file_actions_init(actions)
    libc.posix_spawnattr_init(attributes)
    libc.posix_spawnattr_setflags(attributes, ctypes.c_short(_SETSID))
    for number, end in enumerate(ends):
        libc.posix_spawn_file_actions_adddup2(actions, end, number)
    pid = ctypes.c_int()
    texts = _texts(arguments), _texts([f"{name}={value}" for name, value in environment.items()])
    error = libc.posix_spawn(ctypes.byref(pid), os.fsencode(arguments[0]), actions, attributes, *texts)
    libc.posix_spawn_file_actions_destroy(actions)
    libc.posix_spawnattr_destroy(attributes)
    if error:
        raise OSError(error, os.strerror(error), arguments[0])
    return pid.value


def _texts(texts: Sequence[str]) -> "ctypes.Array[ctypes.c_char_p]":
    """Return an array of C strings that ends with a null pointer."""
    return (ctypes.c_char_p * (len(texts) + 1))(*map(os.fsencode, texts), None)


def start_program(*arguments: str) -> Callable[[], None]:
    """Start `uuv-hil ARGUMENTS` as a child process with the slave's output; return a function that ends it.

    The child also ends when this process ends, for whatever reason. If it ignores SIGTERM it is killed. Raises OSError.
    """
    from hil.common import lifeline
    from hil.common.children import module_command, open_lifeline  # most slaves start no program

    ends = (os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC), 1, 2, open_lifeline())
    try:
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        environment[lifeline.VARIABLE] = lifeline.describe_end(len(ends) - 1, ends[-1])
        pid = spawn(module_command("hil.cli", *arguments), environment, ends)
    finally:
        os.close(ends[0])
        os.close(ends[-1])

    def end() -> None:
        with suppress(ProcessLookupError, ChildProcessError):
            os.kill(pid, signal.SIGTERM)
            deadline = time.monotonic() + END_WITHIN_S
            while not os.waitpid(pid, os.WNOHANG)[0]:
                if time.monotonic() > deadline:
                    os.kill(pid, signal.SIGKILL)
                time.sleep(LOOK_S)

    return end
