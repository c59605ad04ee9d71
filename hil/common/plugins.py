"""Load users' own classes that a file names: `class = "module:Class"`, with the arguments as further keys.

Loading a class runs its code, so only the user's own files may name one. Code that reads files of others does so inside
`refusing`.
"""

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Any

from hil.common.errors import ConfigError

if TYPE_CHECKING:
    from types import TracebackType

OURS = ("hil", "sim")  # packages whose classes a file may name as well
loaded: set[str] = set()  # names of the modules whose classes were asked for


class _OfThread(threading.local):
    refusal = ""


_here = _OfThread()


@contextmanager
def refusing(why: str) -> Iterator[None]:
    """Refuse to load classes in this thread inside the `with`: ConfigError names the class and ends with `why`."""
    before, _here.refusal = _here.refusal, why
    try:
        yield
    finally:
        _here.refusal = before


def load_class(table: dict[str, Any], contract: type, where: str) -> Any:
    """Return an object of the class that the table's key `class` names; the other keys are its keyword arguments.

    The module is searched on Python's path and in the current folder. `contract` is the protocol that the class has to
    follow; if methods are missing, the error names one. `where` (file and section) begins every error message.
    Raises ConfigError.
    """
    name = table.get("class")
    if not isinstance(name, str) or not all(name.partition(":")):
        raise ConfigError(f'{where}: class: expected "module:Class", found {name!r}')
    if _here.refusal:
        raise ConfigError(f"{where}: class {name!r} is not loaded: {_here.refusal}")
    kind = _find(name, f"{where}: class")
    if not isinstance(kind, type):
        raise ConfigError(f"{where}: {name} is no class")
    undefined: frozenset[str] = getattr(kind, "__abstractmethods__", frozenset())
    missing = [name for name in _methods(contract) if name in undefined or not callable(getattr(kind, name, None))]
    if missing:
        to_derive = bool(getattr(contract, "__abstractmethods__", ())) and contract not in kind.__mro__
        remedy = f"derive it from {contract.__name__} of" if to_derive else "see"
        raise ConfigError(f"{where}: {name} has no method {missing[0]!r} ({remedy} {contract.__module__})")
    arguments = {key: value for key, value in table.items() if key != "class"}
    try:
        return kind(**arguments)
    except ConfigError as error:
        raise ConfigError(*[f"{where}: {problem}" for problem in error.args]) from None
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{where}: {name} does not take these keys: {error}") from error


def own_traceback(error: BaseException) -> "TracebackType | None":
    """Return the traceback of an exception from the first line of a user's class on; None if none was running."""
    frame = error.__traceback__
    own = {module for module in loaded if module.partition(".")[0] not in OURS}
    while frame and frame.tb_frame.f_globals.get("__name__") not in own:
        frame = frame.tb_next
    return frame


def _find(name: str, where: str) -> Any:
    module, _, attribute = name.partition(":")
    loaded.add(module)  # before it runs: what it raises then is its own, too
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    try:
        plugin = getattr(import_module(module), attribute)
    except ImportError as error:
        remedy = (
            "it has to be in the current folder or on PYTHONPATH"
            if getattr(error, "name", None) == module
            else "correct its imports"
        )
        raise ConfigError(f"{where}: {module} cannot be imported: {error}; {remedy}") from error
    except SyntaxError as error:
        raise ConfigError(f"{where}: {module} cannot be imported: {error}") from error
    except AttributeError:
        raise ConfigError(f"{where}: {module} has no {attribute!r}") from None
    return plugin


def _methods(contract: type) -> list[str]:
    return [name for name, value in vars(contract).items() if callable(value) and not name.startswith("_")]
