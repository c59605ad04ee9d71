"""TOML as nested dicts: files, kept parsed, and the NAME=VALUE of a command line.

As Python does with its sources, what was read is kept (in the user's cache folder) and taken from there
while the file has the same time and size: a start then loads no TOML parser, which is a tenth of it.
"""

import marshal
import os
import sys
from collections.abc import Iterable
from typing import Any

from hil.errors import ConfigError

Stamp = tuple[int, int]  # time of change in ns, size in bytes


def read_table(path: str) -> dict[str, Any]:
    """The TOML file at `path`. Raises ConfigError if it is missing, cannot be read or is not TOML."""
    try:
        found = os.stat(path)
        stamp = (found.st_mtime_ns, found.st_size)
        kept = _read_cache(path, stamp)
        return _read_toml(path, stamp) if kept is None else kept
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise ConfigError(f"{path}: is a folder, not a file") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None


def value_of(text: str) -> Any:
    """What a command line's `text` stands for: the value TOML reads in it, else the text itself."""
    import tomllib

    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def settings(texts: Iterable[str], name: str) -> dict[str, Any]:
    """NAME=VALUE texts of the command line's `name` as a table. Raises ConfigError."""
    table = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not key or not equals:
            raise ConfigError(f"command line: {name} {text!r} is not NAME=VALUE")
        table[key] = value_of(value)
    return table


def cache_path(path: str) -> str:
    """Where the file at `path` is kept parsed."""
    folder = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    name = os.path.abspath(path).replace(os.path.sep, "%")
    return os.path.join(folder, "uuv-hil", f"{name}.{sys.implementation.cache_tag}")


def _read_toml(path: str, stamp: Stamp) -> dict[str, Any]:
    import tomllib

    try:
        with open(path, "rb") as file:
            table = tomllib.load(file)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from None
    _write_cache(path, stamp, table)
    return table


def _read_cache(path: str, stamp: Stamp) -> dict[str, Any] | None:
    try:
        with open(cache_path(path), "rb") as file:
            if os.fstat(file.fileno()).st_uid != os.getuid():  # never trust what another user left there
                return None
            kept_stamp, table = marshal.load(file)
    except (OSError, EOFError, ValueError, TypeError):  # none, or damaged
        return None
    return table if kept_stamp == stamp else None


def _write_cache(path: str, stamp: Stamp, table: dict[str, Any]) -> None:
    cache = cache_path(path)
    fresh = f"{cache}.{os.getpid()}"
    try:
        data = marshal.dumps((stamp, table))
        os.makedirs(os.path.dirname(cache), mode=0o700, exist_ok=True)
        with open(fresh, "wb") as file:
            file.write(data)
        os.replace(fresh, cache)
    except (OSError, ValueError):  # a folder we may not write; a date, which cannot be kept
        return
