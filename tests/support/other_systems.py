"""Names of the standard library that Linux has and Windows or macOS lacks, by the stubs that come with mypy."""

import ast
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mypy

STUBS = Path(mypy.__file__).parent / "typeshed" / "stdlib"
# Those of which parts are missing, and those that Windows lacks whole.
PARTLY = ("os", "signal", "select", "socket", "time", "mmap")
WHOLLY = (
    "fcntl", "termios", "resource", "pty", "tty", "pwd", "grp", "syslog", "curses", "_curses", "readline", "crypt",
    "nis", "spwd", "ossaudiodev",
)  # fmt: skip


def missing_names() -> dict[str, list[str]]:
    """Return the names that each module has on Linux and not on both of the others."""
    return {
        module: sorted(_names(module, "linux") - (_names(module, "win32") & _names(module, "darwin")))
        for module in PARTLY
    }


def _names(module: str, system: str) -> set[str]:
    file = STUBS / f"{module}.pyi"
    text = (file if file.exists() else STUBS / module / "__init__.pyi").read_text(encoding="utf-8")
    conditions = {"sys": SimpleNamespace(platform=system, version_info=sys.version_info)}
    return set(_defined(ast.parse(text).body, conditions))


def _defined(body: Iterable[ast.stmt], conditions: dict[str, Any]) -> Iterator[str]:
    for node in body:
        match node:
            case ast.If():
                is_true = eval(ast.unparse(node.test), conditions)
                yield from _defined(node.body if is_true else node.orelse, conditions)
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.AnnAssign(target=ast.Name(id=name)):
                yield name
            case ast.Assign(targets=[ast.Name(id=name)]):
                yield name
            case ast.ImportFrom():
                yield from (imported.asname or imported.name for imported in node.names)
