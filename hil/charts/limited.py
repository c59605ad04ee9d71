"""Call a function in a separate process, within limits on memory and time: the file that it reads may be hostile.

    python -P -m hil.charts.limited MEMORY SECONDS < CALL

CALL is pickled: the function as "module:name", its arguments, and whether it reports. The process writes pickled pairs
to its standard output: "report" and a value as often as the function reports, then the name of an error and its text,
or "" and the result.
"""

import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import import_module
from threading import Timer
from typing import IO, Any, NamedTuple, cast

from hil.common import errors
from hil.common.children import limit_self, module_command, package_environment, start_child
from hil.common.errors import HilError
from hil.common.lifeline import die_with_parent

REPORT = "report"


class Limits(NamedTuple):
    """Limits of a process: `memory` in bytes of address space, `processor` time in s, and `seconds` in all."""

    memory: int
    processor: int
    seconds: float = 1e5


class EndedError(Exception):
    """The process ended without a result: it has reached a limit, or a library has crashed."""


def call(function: str, *arguments: Any, limits: Limits, report: Callable[[Any], None] | None = None) -> Any:
    """Return what `function`, as "module:name", returns for `arguments` in a process of its own.

    With `report` the function gets a key of that name, and `report` is called with each value that it reports. Raises
    the HilError that the function raises, and EndedError.
    """
    environment = {**package_environment(), "OPENBLAS_NUM_THREADS": "1"}
    with start_child(
        module_command("hil.charts.limited", str(limits.memory), str(limits.processor)), environment=environment,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        timer, output = Timer(limits.seconds, process.kill), cast(IO[bytes], process.stdout)
        timer.start()
        try:
            with suppress(BrokenPipeError), cast(IO[bytes], process.stdin) as stdin:  # it has ended already
                stdin.write(pickle.dumps((function, arguments, report is not None)))
            kind, value = pickle.load(output)
            while kind == REPORT and report:
                report(value)
                kind, value = pickle.load(output)
        except (EOFError, pickle.UnpicklingError):
            process.wait()
            late, code = timer.finished.is_set(), process.returncode
            how = f"not finished within {limits.seconds:g} s" if late else f"ended with exit code {code}"
            raise EndedError(how if late or code >= 0 else f"ended with signal {-code}") from None
        finally:
            timer.cancel()
            process.kill()  # has no effect if the process has ended
    if kind:
        raise getattr(errors, kind)(value)
    return value


def main(memory: str, processor: str) -> None:
    """Call the function that standard input names, and write its result."""
    die_with_parent()
    limit_self(int(memory), int(processor))
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # libraries may print
    function, arguments, reports = pickle.load(sys.stdin.buffer)

    def send(kind: str, value: Any) -> None:
        pickle.dump((kind, value), output, pickle.HIGHEST_PROTOCOL)
        output.flush()

    module, _, name = function.partition(":")
    keys = {"report": partial(send, REPORT)} if reports else {}
    try:
        send("", getattr(import_module(module), name)(*arguments, **keys))
    except HilError as error:
        send(type(error).__name__, str(error))


if __name__ == "__main__":
    main(*sys.argv[1:])
