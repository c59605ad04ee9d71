"""Run the programs that read and grid charts in the test's own process, because their libraries take long to load."""

import io
import sys
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from subprocess import CompletedProcess
from typing import Any

import pytest

from hil.common import children

PROGRAMS = ("hil.charts.build_process", "hil.charts.sources.s57_process", "hil.charts.imports.mesh_process")


def run_here(program: str, arguments: Sequence[str], data: bytes) -> CompletedProcess[bytes]:
    """Run `main` of a program with this input, without its limits; return its exit code and output."""
    module: Any = import_module(program)
    streams = [io.TextIOWrapper(io.BytesIO(content), write_through=True) for content in (data, b"", b"")]
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("default")  # as in a process of its own
        patch.setattr(module, "limit_self", lambda *_: None)
        patch.setattr(module, "die_with_parent", lambda: None)
        for name, stream in zip(("stdin", "stdout", "stderr"), streams, strict=True):
            patch.setattr(sys, name, stream)
        code = module.main(*arguments)
    _, output, errors = (stream.buffer.getvalue() for stream in streams)
    return CompletedProcess([program, *arguments], code, output, errors)


class ChildHere:
    """What `hil.charts` uses of a child process: the program runs when its input is closed."""

    returncode: int | None = None

    def __init__(self, program: str, arguments: Sequence[str]) -> None:
        self._program, self._arguments = program, arguments
        self.stdin, self.stdout = _Input(self._run), io.BytesIO()

    def _run(self, data: bytes) -> None:
        done = run_here(self._program, self._arguments, data)
        self.stdout, self.returncode = io.BytesIO(done.stdout), done.returncode

    def __enter__(self) -> "ChildHere":
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing is left to be waited for."""

    def communicate(self, data: bytes = b"", timeout: float | None = None) -> tuple[bytes, bytes]:
        self._run(data)
        return self.stdout.getvalue(), b""

    def kill(self) -> None:
        """It has ended."""


class _Input(io.BytesIO):
    """Input that is passed on as a whole when it is closed."""

    def __init__(self, closed: Callable[[bytes], None]) -> None:
        super().__init__()
        self._pass_on = closed

    def close(self) -> None:
        if not self.closed:
            data = self.getvalue()
            super().close()
            self._pass_on(data)


def _program_of(command: Sequence[str]) -> tuple[str, Sequence[str]] | None:
    for program in PROGRAMS:
        usual = children.module_command(program)
        if list(command[: len(usual)]) == list(usual):
            return program, command[len(usual) :]
    return None


def start_here(command: Sequence[str], **options: Any) -> Any:
    """Start one of `PROGRAMS` in this process, and any other command as a process."""
    found = _program_of(command)
    return ChildHere(*found) if found else children.start_child(command, **options)


def finish_here(command: Sequence[str], seconds: float) -> CompletedProcess[bytes]:
    """Run one of `PROGRAMS` in this process, and any other command as a process."""
    found = _program_of(command)
    return run_here(*found, b"") if found else children.finish_child(command, seconds)
