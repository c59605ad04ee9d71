"""Diagnostics for tests, made of the table: a name that is not in it is a KeyError."""

from typing import Any

from hil.ros.diagnostics import Diagnostics


def reported(**values: Any) -> Diagnostics:
    """Return the diagnostics of a slave that reports these figures."""
    output = Diagnostics()
    for name, value in values.items():
        output[name] = value
    return output
