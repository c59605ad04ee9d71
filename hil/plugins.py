"""Classes of a user's own, named in a file of ours: `class = "module:Class"`, and its arguments beside it."""

import os
import sys
from importlib import import_module
from typing import Any

from hil.errors import ConfigError


def load_class(table: dict[str, Any], contract: type, where: str) -> Any:
    """An object of the class that the table's key `class` names, made with its other keys by keyword.

    The module is looked for where Python looks, and in the present folder. `contract` is the protocol that it is
    to follow: methods it lacks are named. `where` (file and section) opens every error message. Raises ConfigError.
    """
    name = table.get("class")
    if not isinstance(name, str) or not all(name.partition(":")):
        raise ConfigError(f'{where}: class: expected "module:Class", found {name!r}')
    kind = _find(name, f"{where}: class")
    arguments = {key: value for key, value in table.items() if key != "class"}
    try:
        made = kind(**arguments)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{where}: {name} does not take these keys: {error}") from error
    missing = [method for method in _methods(contract) if not callable(getattr(made, method, None))]
    if missing:
        raise ConfigError(f"{where}: {name} has no method {missing[0]!r} (see {contract.__module__})")
    return made


def _find(name: str, where: str) -> Any:
    module, _, attribute = name.partition(":")
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    try:
        return getattr(import_module(module), attribute)
    except ImportError as error:
        raise ConfigError(f"{where}: {module} cannot be imported: {error}; it has to be on PYTHONPATH") from error
    except AttributeError:
        raise ConfigError(f"{where}: {module} has no {attribute!r}") from None


def _methods(contract: type) -> list[str]:
    return [name for name, value in vars(contract).items() if callable(value) and not name.startswith("_")]
