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


def spawn(module: str, *arguments: str, ends: Sequence[int], **variables: str) -> int:
    """Start a module of ours in a new session, with the descriptors `ends` as its 0, 1 and 2; return its pid.

    It also ends when this process ends, for whatever reason. `variables` are added to its environment. Raises OSError.
    """
    from hil.common import lifeline
    from hil.common.children import module_command, open_lifeline  # most slaves start no program

    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), **variables}
    end = open_lifeline()
    try:
        environment[lifeline.VARIABLE] = lifeline.describe_end(len(ends), end)
        return _spawn(module_command(module, *arguments), environment, (*ends, end))
    finally:
        os.close(end)


def spawn_piped(module: str, *arguments: str, **variables: str) -> tuple[int, int, int, int]:
    """Start a module of ours with pipes; return its pid, and our ends of its standard input, output and error.

    Raises OSError.
    """
    (its_input, to_it), (output, its_output), (errors, its_errors) = (os.pipe2(os.O_CLOEXEC) for _ in range(3))
    its_ends = its_input, its_output, its_errors
    try:
        return spawn(module, *arguments, ends=its_ends, **variables), to_it, output, errors
    except OSError:
        for end in (to_it, output, errors):
            os.close(end)
        raise
    finally:
        for end in its_ends:
            os.close(end)


def _spawn(arguments: Sequence[str], environment: Mapping[str, str], ends: Sequence[int]) -> int:
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

    If it ignores SIGTERM it is killed. Raises OSError.
    """
    nothing = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)
    try:
        pid = spawn("hil.cli", *arguments, ends=(nothing, 1, 2))
    finally:
        os.close(nothing)

    def end() -> None:
        with suppress(ProcessLookupError, ChildProcessError):
            os.kill(pid, signal.SIGTERM)
            deadline = time.monotonic() + END_WITHIN_S
            while not os.waitpid(pid, os.WNOHANG)[0]:
                if time.monotonic() > deadline:
                    os.kill(pid, signal.SIGKILL)
                time.sleep(LOOK_S)

    return end
