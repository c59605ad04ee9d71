"""Read TOML as nested dicts: files, with a cache of parsed ones, and NAME=VALUE of a command line.

Parsed files are cached in the user's cache folder, as Python caches its bytecode, and used while the file has the same
time and size. A start then imports no TOML parser, which saves a tenth of its time.
"""

import codecs
import marshal
import os
import stat
import sys
from collections.abc import Iterable
from contextlib import suppress
from types import ModuleType
from typing import Any

from hil.common.errors import ConfigError

LARGEST = 16 << 20  # bytes of a file; our own largest has some thousand
DEEPEST = 32  # nesting of tables and arrays; our own deepest has five

# Limits of the cache: beyond the first or second one, the oldest files are removed down to half of it.
MAX_CACHED = 500
MAX_CACHED_BYTES = 32 << 20
LARGEST_CACHED = 1 << 20  # bytes of one cached file
PROGRAM = "uuv-hil-stm32-native"  # programs of firmware_stub.native in the same folder, which that removes itself

PRIVATE = 0o600  # permissions of a file for this user alone

Stamp = tuple[int, int]  # time of change in ns, size in bytes


def read_table(path: str) -> dict[str, Any]:
    """Return the TOML file at `path`. Raises ConfigError if it is missing, cannot be read or is not TOML."""
    stamp = check_file(path, LARGEST)
    cached: dict[str, Any] | None = read_cached(path, stamp)
    return _read_toml(path, stamp) if cached is None else cached


def read_bytes(path: str, largest: int = LARGEST) -> bytes:
    """Return the content of the file at `path`. Raises ConfigError, also if it has more than `largest` bytes."""
    check_file(path, largest)
    try:
        with open(path, "rb") as file:
            return file.read(largest)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None


def check_file(path: str, largest: int) -> Stamp:
    """Return the stamp of a regular file of at most `largest` bytes. Raises ConfigError for anything else."""
    try:
        status = os.stat(path)
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:  # ValueError for a path with a zero byte
        raise ConfigError(f"{path}: cannot be read: {getattr(error, 'strerror', error)}") from None
    if stat.S_ISDIR(status.st_mode):
        raise ConfigError(f"{path}: is a folder, not a file")
    if not stat.S_ISREG(status.st_mode):  # a pipe may block, a device may never end
        raise ConfigError(f"{path}: is no regular file")
    if status.st_size > largest:
        raise ConfigError(f"{path}: has {status.st_size >> 20} MiB; such a file has at most {largest >> 20} MiB")
    return status.st_mtime_ns, status.st_size


def value_of(text: str) -> Any:
    """Return the value of a command line's `text`: as TOML if it is valid TOML, else the text itself."""
    try:
        return parse_toml(f"value = {text}")["value"]
    except (ValueError, RecursionError):  # not TOML, or a number with thousands of digits, or nested too deep
        return text


def parse_toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text. Raises ValueError if it is not TOML, RecursionError if nested too deep."""
    table: dict[str, Any] = _parser().loads(text)
    return table


def _parser() -> ModuleType:
    if sys.version_info >= (3, 11):
        import tomllib as parser
    else:  # the same parser as a package
        import tomli as parser
    return parser


def output_file(text: str) -> str:
    """Return `text`, the name of an output file, after a test that it can be opened. Raises ConfigError.

    Its folder has to exist: it may be mistyped, so it is not created. Named pipes are refused, as they wait for a
    reader.
    """
    exists = os.path.exists(text)
    try:
        if exists and stat.S_ISFIFO(os.stat(text).st_mode) and not os.path.realpath(text).startswith("/proc/"):
            raise OSError(0, "it is a pipe")
        os.close(os.open(text, os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_NONBLOCK", 0), 0o666))
        if not exists:
            os.remove(text)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "a zero byte is in its name"
        folder = os.path.dirname(os.path.abspath(text))
        if not os.path.isdir(folder):
            reason = f"{folder} is a file" if os.path.exists(folder) else f"there is no folder {folder}"
        raise ConfigError(f"{text}: cannot be written: {reason}; name a file in a folder of yours") from None
    return text


def settings(texts: Iterable[str], name: str) -> dict[str, Any]:
    """Return the NAME=VALUE texts of the option `name` as a table. Raises ConfigError."""
    table = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not key or not equals:
            raise ConfigError(f"command line: {name} {text!r} is not NAME=VALUE")
        table[key] = value_of(value)
    return table


def state_path(*names: str) -> str:
    """Return the path of a file or folder in which this user's programs store what outlives them."""
    home = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")
    return os.path.join(home, "uuv-hil", *names)


def cache_path(path: str) -> str:
    """Return the path of the cached, parsed version of the file at `path`."""
    folder = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    name = os.path.abspath(path).replace(os.path.sep, "%")
    return os.path.join(folder, "uuv-hil", f"{name}.{sys.implementation.cache_tag}")


def forget_parsed(folder: str) -> None:
    """Remove the cached versions of the files in a folder that is being deleted."""
    cache, name = os.path.split(cache_path(os.path.join(folder, "")).removesuffix(f".{sys.implementation.cache_tag}"))
    try:
        for file in os.listdir(cache):
            if file.startswith(f"{name}%"):
                os.unlink(os.path.join(cache, file))
    except OSError:  # no cache, or another process is removing the same files
        return


def _read_toml(path: str, stamp: Stamp) -> dict[str, Any]:
    import re

    data = read_bytes(path)
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise ConfigError(f"{path}: not valid TOML: its text is UTF-16; save it as UTF-8")
    try:
        text = data.decode("utf-8-sig")  # some editors write a byte order mark
        if re.search(rf"(?<![\w-])(?:[\w-]+\.){{{DEEPEST}}}", text):  # a.b.c...: would take the parser minutes
            raise RecursionError
        table = parse_toml(text)
        if _is_deep(table):
            raise RecursionError
    except RecursionError:
        raise ConfigError(f"{path}: tables or arrays in each other, more than {DEEPEST} deep") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: is not UTF-8 text; save it as UTF-8") from None
    except _parser().TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from None
    except ValueError:  # its own message names a setting of the interpreter
        digits = sys.get_int_max_str_digits()
        raise ConfigError(f"{path}: not valid TOML: a number of more than {digits} digits") from None
    write_cached(path, stamp, table)
    return table


def _is_deep(table: dict[str, Any]) -> bool:
    """Return whether tables and arrays are nested more than DEEPEST deep."""
    level: list[Any] = [table]
    for _ in range(DEEPEST):
        inner = [value for value in level if isinstance(value, (dict, list))]
        if not inner:
            return False
        level = [item for value in inner for item in (value.values() if isinstance(value, dict) else value)]
    return True


def read_cached(path: str, stamp: Any) -> Any:
    """Return the value that `write_cached` stored for `path` with the same `stamp`; None if there is none."""
    try:
        with open(cache_path(path), "rb") as file:
            # Do not trust files of another user. Windows has no such numbers, and the folder belongs to one user.
            if hasattr(os, "getuid") and os.fstat(file.fileno()).st_uid != os.getuid():
                return None
            cached_stamp, value = marshal.loads(file.read())  # load() would read it number by number
    except (OSError, EOFError, ValueError, TypeError):  # missing or damaged
        return None
    return value if cached_stamp == stamp else None


def write_cached(path: str, stamp: Any, value: Any) -> None:
    """Store `value`, of plain types, in the cache for `path`, if it is small and the folder is writable."""
    cache = cache_path(path)
    try:
        data = marshal.dumps((stamp, value))
        if len(data) > LARGEST_CACHED:
            return
        write_atomically(cache, data, PRIVATE)
        _prune(os.path.dirname(cache))
    except (OSError, ValueError):  # a read-only folder, or a date, which marshal cannot store
        return


def save_text(path: str, text: str) -> None:
    """Write a file that a person has asked for, and its folder. Raises ConfigError."""
    try:
        os.makedirs(os.path.dirname(path) or ".", exist_ok=True)
        with open(path, "w", newline="", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}; name a file in a folder of yours") from None


def csv_text(rows: Iterable[Iterable[Any]]) -> str:
    """Return rows as CSV."""
    import csv
    import io

    text = io.StringIO()
    csv.writer(text).writerows(rows)
    return text.getvalue()


def write_atomically(path: str, content: str | bytes, mode: int = 0o666) -> None:
    """Write a file that others read whole or not at all; its folder is made, and a link is replaced by the file.

    Text is written in UTF-8. `mode`: its permissions, less the umask; with PRIVATE nobody else can read it at any time.
    Raises OSError.
    """
    new = f"{path}.{os.getpid()}"
    os.makedirs(os.path.dirname(path) or ".", mode=0o700 if mode == PRIVATE else 0o777, exist_ok=True)
    with suppress(FileNotFoundError):
        os.unlink(new)
    try:
        with open(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
        os.replace(new, path)
    except OSError:
        with suppress(OSError):
            os.unlink(new)
        raise


def _prune(folder: str) -> None:
    """Remove the oldest files of the cache if their number or total size is too large. Raises OSError."""
    with os.scandir(folder) as entries:
        cached = [
            (entry.path, entry.stat()) for entry in entries if entry.is_file() and not entry.name.startswith(PROGRAM)
        ]
    size = sum(status.st_size for _, status in cached)
    if len(cached) <= MAX_CACHED and size <= MAX_CACHED_BYTES:
        return
    cached.sort(key=lambda file: file[1].st_mtime_ns, reverse=True)
    size = 0
    for number, (path, status) in enumerate(cached):
        size += status.st_size
        if number >= MAX_CACHED // 2 or size > MAX_CACHED_BYTES // 2:
            os.unlink(path)
