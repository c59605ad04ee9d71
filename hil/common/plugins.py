"""Load users' own classes that a file names, and what other packages add by entry points.

A file names a class as `class = "module:Class"`, with the arguments as further keys. A package that is installed beside
this one adds names by entry points of the group "uuv_hil.KIND", of each KIND in `KINDS`:

    [project.entry-points."uuv_hil.planners"]
    lawnmower = "my_package.lawnmower:Lawnmower"

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
# What an entry point of each kind names. Presets are TOML files in the folder of the package that it names.
KINDS = {
    "planners": "a class of hil.Planner",
    "controllers": "a class of hil.Controller",
    "sensors": "a class of sim.OwnSensor",
    "forces": "a class of sim.Force",
    "protocols": "a function (role, thrusters, **settings) that returns a hil.Protocol",
    "wires": "a function (target, role) that returns a hil.Wire, for addresses NAME:TARGET",
    "instruments": "a class of hil.instruments.contract.Instrument",
    "gateways": "a function (arguments) that returns an exit code, for `uuv-hil gateway NAME`",
    "vehicles": "a package with NAME.toml",
    "worlds": "a package with NAME.toml",
    "scenarios": "a package with NAME.toml",
}
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


def installed(kind: str) -> dict[str, str]:
    """Return what other packages add of a kind of `KINDS`: name -> place, "module:object" or a package.

    To search them takes 20 ms and 3 MiB, so callers look among our own names first.
    """
    from importlib.metadata import entry_points

    return {entry.name: entry.value for entry in entry_points(group=f"uuv_hil.{kind}")}


def installed_file(kind: str, name: str) -> str:
    """Return the path of the preset `name` that another package adds; "" if none does."""
    from importlib.util import find_spec

    package = installed(kind).get(name)
    spec = find_spec(package) if package else None
    folders = (spec.submodule_search_locations or ()) if spec else ()
    return next((path for folder in folders if os.path.exists(path := os.path.join(folder, f"{name}.toml"))), "")


def load_object(place: str, where: str) -> Any:
    """Return the object at "module:name", searched on Python's path and in the current folder.

    `where` (file and key) begins every error message. Raises ConfigError.
    """
    if _here.refusal:
        raise ConfigError(f"{where} {place!r} is not loaded: {_here.refusal}")
    return _find(place, where)


def load_class(table: dict[str, Any], contract: type, where: str, among: str) -> Any:
    """Return an object of the class that the table's key `class` names; the other keys are its keyword arguments.

    The name is "module:Class", or one that another package adds to the kind `among`. `contract` is the protocol that
    the class has to follow; if methods are missing, the error names one. `where` (file and section) begins every error
    message. Raises ConfigError.
    """
    name = table.get("class")
    if isinstance(name, str) and ":" not in name:
        name = installed(among).get(name, name)
    if not isinstance(name, str) or not all(name.partition(":")):
        known = ", ".join(sorted(installed(among)))
        raise ConfigError(
            f'{where}: class: expected "module:Class", found {name!r}'
            + (f"; installed packages add: {known}" if known else "")
        )
    kind = load_object(name, f"{where}: class")
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
