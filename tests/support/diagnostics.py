"""Diagnostics for tests, made from the table of figures; an unknown name is a KeyError."""

from typing import Any

from hil.ros.diagnostics import Diagnostics


def reported(**values: Any) -> Diagnostics:
    """Return the diagnostics of a slave that reports these figures."""
    output = Diagnostics()
    for name, value in values.items():
        output[name] = value
    return output
