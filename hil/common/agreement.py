"""Ask the person at the terminal before something is done that cannot be undone."""

import sys

from hil.common.errors import ConfigError

LOOK_FIRST = "look at it with --dry-run, do it with --yes"


def agreed(question: str, otherwise: str) -> bool:
    """Return True if the answer is yes. Raises ConfigError, with what to do `otherwise`, where nobody can be asked."""
    if not sys.stdin.isatty():
        raise ConfigError(f"nobody can be asked here: {otherwise}")
    return input(f"{question} [y/N] ").strip().lower() in ("y", "yes")
