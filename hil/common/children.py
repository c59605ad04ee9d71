"""Start child processes that end with this one, whatever ends it, SIGKILL included.

All that the project starts and does not wait for at once is started here, so that nothing of it is left on a port, a
link or a processor. How it works is described in hil.common.lifeline, which is the child's side: our own programs call
`die_with_parent` first of all, and those of others are started by `foreign_command`.
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
_SAFE_PATH = "PYTHONSAFEPATH"  # as the interpreter's option -P; Python 3.10 has neither

_pipe: list[int] = []  # its ends, the read end first; of two pipes if two threads began at once, which is as good


def start_child(
    command: Sequence[str], *, environment: Mapping[str, str] | None = None, pass_fds: Sequence[int] = (), **how: Any
) -> "subprocess.Popen[Any]":
    """Start a program in a session of its own that ends with this process; the rest is as of `subprocess.Popen`.

    command: one of our programs (`module_command`), or a `foreign_command`. environment: instead of this process's.
    Ctrl-C in the terminal does not reach it. Raises OSError if it cannot be started.
    """
    import subprocess  # the slave imports this file, and may never start anything

    end = open_lifeline()
    variables = {
        **(os.environ if environment is None else environment),
        lifeline.VARIABLE: lifeline.describe_end(end, end),
    }
    try:
        return subprocess.Popen(command, env=variables, pass_fds=(*pass_fds, end), start_new_session=True, **how)
    finally:
        os.close(end)


def finish_child(command: Sequence[str], seconds: float) -> "subprocess.CompletedProcess[bytes]":
    """Run one of our programs to its end, for at most so long; return its exit code, its output and its errors.

    Raises subprocess.TimeoutExpired, OSError.
    """
    import subprocess

    with start_child(
        command, environment=package_environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        try:
            output, errors = process.communicate(timeout=seconds)
        finally:
            process.kill()  # does nothing to one that has ended
    return subprocess.CompletedProcess(command, process.returncode, output, errors)


def limit_self(memory_bytes: int, processor_seconds: int) -> None:
    """Bound the address space and the processor time of this process, for work on a file of somebody else."""
    if sys.platform == "win32":  # which has no such limits
        return
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    resource.setrlimit(resource.RLIMIT_CPU, (processor_seconds, processor_seconds))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def open_lifeline() -> int:
    """Return a descriptor for one child to inherit; close it here after the child has started.

    The child's environment names it: `lifeline.describe_end` in `lifeline.VARIABLE`.
    Each child needs an open file of its own, as it is there that the kernel keeps whom to signal.
    """
    return os.open(_path("self"), os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)


def module_command(module: str, *arguments: str) -> list[str]:
    """Return the command that runs a module of ours, which does not look for modules in the current folder."""
    return python_command("-m", module, *arguments)


def python_command(*words: str) -> list[str]:
    """Return the command that gives this interpreter `words`: options, then -c CODE or -m MODULE, then arguments.

    Modules are not looked for in the current folder.
    """
    if sys.version_info >= (3, 11):
        return [sys.executable, "-P", *words]
    at = next(number for number, word in enumerate(words) if word in ("-c", "-m"))
    options, (kind, code), arguments = words[:at], words[at : at + 2], words[at + 2 :]
    if kind == "-m":
        code = f"from runpy import run_module\nrun_module({code!r}, run_name='__main__', alter_sys=True)"
    return [sys.executable, *options, "-c", f"import sys\ndel sys.path[0]\n{code}", *arguments]


def foreign_command(*command: str) -> list[str]:
    """Return the command that runs a program of others so that it ends with this process."""
    return [sys.executable, "-I", "-S", lifeline.__file__, *command]


def package_environment() -> dict[str, str]:
    """Return this process's environment, with the path of our packages if they are not installed."""
    if os.path.basename(ROOT) in _INSTALLED:
        return dict(os.environ)
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, (ROOT, os.environ.get("PYTHONPATH"))))}


@contextmanager
def worker_options() -> Iterator[dict[str, Any]]:
    """Provide options of `joblib.Parallel` with which the processes of loky end with this one.

    These look for modules in the current folder no more than our own programs do; but under Python 3.10, which cannot
    be told so, until they have taken over this process's `sys.path`. Only Linux can end them with this process.

    multiprocessing's own process is started here, as up to Python 3.12 its start lets held back signals through:
    `hil.common.stop.ctrl_c_held_back`, inside which the workers are to be started.
    """
    from warnings import filterwarnings

    filterwarnings("ignore", r"\d+ tasks which were still being processed", module="joblib")  # at Ctrl-C, no news
    if sys.platform != "linux":
        yield {}
        return
    from multiprocessing.resource_tracker import ensure_running

    ensure_running()
    before = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = "1"
    try:
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
    """Close the parent's lifelines in a process forked without an exec."""
    while _pipe:
        os.close(_pipe.pop())


if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
    os.register_at_fork(after_in_child=_let_go)
