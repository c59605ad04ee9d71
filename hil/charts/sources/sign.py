"""Decide whether values are heights or depths: by what is said, by their signs where all agree, never by guess."""

import re
from collections.abc import Iterable
from typing import Literal

from hil.common.errors import ConfigError

Positive = Literal["auto", "up", "down"]

_UP = {"elevation", "height", "altitude", "topo", "topography"}
_DOWN = {"depth", "sounding", "soundings"}


def is_upwards(path: str, positive: Positive, names: Iterable[str], low: float, high: float) -> bool:
    """Return whether values between `low` and `high` m count upwards, as `positive` or their `names` say.

    Without such a name all of one sign are a seabed: below zero they are heights, above it depths; so they are where
    the name says depth and all are below zero. Raises ConfigError where nothing tells.
    """
    if positive != "auto":
        return positive == "up"
    words = {word for name in names for word in re.split(r"[^a-z]+", name.lower())}
    if high <= 0.0 and low < 0.0:
        return True
    if words & _UP:
        return True
    if words & _DOWN or low >= 0.0:
        return False
    raise ConfigError(
        f"{path}: values from {low:g} to {high:g} m, and nothing says whether they are heights or depths: say "
        "--positive up or --positive down"
    )
