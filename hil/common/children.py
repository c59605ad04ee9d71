"""Start child processes that end when this one ends, however it ends, SIGKILL included.

All processes that the project starts without waiting for them are started here, so that none is left over to block a
port, a link or a processor. hil.common.lifeline is the child's side and explains the mechanism: our own programs call
`die_with_parent` first; other programs are started by `foreign_command`.
"""

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from hil.common import lifeline

if TYPE_CHECKING:
    import subprocess

ROOT = os.path.dirname(
    os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
)  # the folder of the project's packages
_INSTALLED = ("site-packages", "dist-packages")
_SAFE_PATH = "PYTHONSAFEPATH"  # same as the interpreter's option -P; Python 3.10 has neither

_pipe: list[int] = []  # read end, write end; a second pipe, if two threads start at once, does no harm


def start_child(
    command: Sequence[str], *, environment: Mapping[str, str] | None = None, pass_fds: Sequence[int] = (), **how: Any
) -> "subprocess.Popen[Any]":
    """Start a program in a new session, to end with this process; `how` as for `subprocess.Popen`.

    command: one of our programs (`module_command`), or a `foreign_command`. environment: replaces this process's.
    Ctrl-C in the terminal does not reach the program. Raises OSError if it cannot be started.
    """
    import subprocess  # not loaded by a slave that starts no process

    end = open_lifeline()
    variables = {
        **(os.environ if environment is None else environment),
        lifeline.VARIABLE: lifeline.describe_end(end, end),
    }
    try:
        return subprocess.Popen(command, env=variables, pass_fds=(*pass_fds, end), start_new_session=True, **how)
    finally:
        os.close(end)


def limit_self(memory_bytes: int, processor_seconds: int) -> None:
    """Limit this process's address space and processor time, for work on a file from somebody else."""
    if sys.platform == "win32":  # Windows has no such limits
        return
    import resource

    wanted = {resource.RLIMIT_AS: memory_bytes, resource.RLIMIT_CPU: processor_seconds, resource.RLIMIT_CORE: 0}
    for which, most in wanted.items():
        hard = resource.getrlimit(which)[1]  # which only root may raise
        most = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(which, (most, most))


def open_lifeline() -> int:
    """Return a descriptor for one child to inherit; close it here after the child has started.

    The child's environment names it: `lifeline.describe_end` in `lifeline.VARIABLE`. Each child needs its own open
    file, because the kernel stores in the open file which process to signal.
    """
    return os.open(_path("self"), os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)


def module_command(module: str, *arguments: str) -> list[str]:
    """Return the command that runs a module of ours; it does not import modules from the current folder."""
    return python_command("-m", module, *arguments)


def python_command(*command_line: str) -> list[str]:
    """Return the command that runs this interpreter with `command_line`: options, -c CODE or -m MODULE, arguments.

    Modules are not imported from the current folder. With -m no word has a line break: a unit of systemd cannot.
    """
    if sys.version_info >= (3, 11):
        return [sys.executable, "-P", *command_line]
    at = next(number for number, word in enumerate(command_line) if word in ("-c", "-m"))
    options, (kind, code), arguments = command_line[:at], command_line[at : at + 2], command_line[at + 2 :]
    if kind == "-c":
        code = f"import sys\ndel sys.path[0]\n{code}"
    else:
        run = f"run_module({code!r}, run_name='__main__', alter_sys=True)"
        code = f"import sys; del sys.path[0]; from runpy import run_module; {run}"
    return [sys.executable, *options, "-c", code, *arguments]


def foreign_command(*command: str) -> list[str]:
    """Return the command that runs a program of others such that it ends with this process."""
    return [sys.executable, "-I", "-S", lifeline.__file__, *command]


def package_environment() -> dict[str, str]:
    """Return this process's environment, with the path of our packages if they are not installed."""
    if os.path.basename(ROOT) in _INSTALLED:
        return dict(os.environ)
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, (ROOT, os.environ.get("PYTHONPATH"))))}


@contextmanager
def worker_options() -> Iterator[dict[str, Any]]:
    """Provide options of `joblib.Parallel` that make the worker processes of loky end with this one.

    The workers do not import modules from the current folder; under Python 3.10, which has no option for this, they may
    do so until they have copied this process's `sys.path`. Only on Linux do they end with this process.

    The helper process of multiprocessing is started here, because up to Python 3.12 its start releases held back
    signals. The workers have to be started inside `hil.common.stop.ctrl_c_held_back`.
    """
    from warnings import filterwarnings

    filterwarnings("ignore", r"\d+ tasks which were still being processed", module="joblib")  # at Ctrl-C, no news
    if sys.platform != "linux":
        yield {}
        return
    from multiprocessing.resource_tracker import ensure_running

    before = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = "1"
    try:
        ensure_running()
        yield {"initializer": lifeline.die_with, "initargs": (_path(str(os.getpid())),)}
    finally:
        if before is None:
            del os.environ[_SAFE_PATH]
        else:
            os.environ[_SAFE_PATH] = before


def _path(process: str) -> str:
    """Return the path of the pipe's read end, as another process sees it."""
    if not _pipe:
        _pipe.extend(os.pipe2(os.O_CLOEXEC))
    return f"/proc/{process}/fd/{_pipe[0]}"


def _let_go() -> None:
    """Close the parent's lifelines in a process that was forked without an exec."""
    while _pipe:
        os.close(_pipe.pop())


if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
    os.register_at_fork(after_in_child=_let_go)
