"""Modules that are imported on first use: each worker collects all tests, but runs only some of them."""

from importlib import import_module
from operator import attrgetter
from typing import Any


class _LazyModule:
    """A stand-in with the attributes of a module, or of one of its attributes."""

    def __init__(self, name: str, attribute: str) -> None:
        self._name = name
        self._attribute = attribute

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # what pytest looks for in all that a module of tests holds
            raise AttributeError(name)
        return attrgetter(".".join(filter(None, (self._attribute, name))))(import_module(self._name))


def import_lazily(name: str, attribute: str = "") -> Any:
    """Return a stand-in for a module that takes long to import, to be used like it.

    attribute: an attribute of the module ("a" or "a.b") that it replaces instead.
    """
    return _LazyModule(name, attribute)
