"""Find a ROS package without ROS: by ROS's environment variables, or near a file."""

import os
import re
from collections import deque
from collections.abc import Iterator

_ASCENT = 4  # how many folders up from the file
_MOST_FOLDERS = 20_000  # looked into below those, the nearest first: more than a workspace has, less than a disk


def find_package(name: str, path: str) -> str | None:
    """Return the folder of the package `name`, None if there is none.

    Looked for as `find_packages` does.
    """
    return next(find_packages(name, path), None)


def find_packages(name: str, path: str) -> Iterator[str]:
    """Yield the folders that may be the package `name`, the likeliest first.

    Looked for as ROS does, `share/NAME` of the folders in AMENT_PREFIX_PATH and below those in ROS_PACKAGE_PATH, then
    around the file at `path`: its parents and all below them. A folder is a package by its name or its package.xml.
    """
    for prefix in _variable("AMENT_PREFIX_PATH"):
        folder = os.path.join(prefix, "share", name)
        if os.path.isdir(folder):
            yield folder
    seen: set[str] = set()
    for top in (*_variable("ROS_PACKAGE_PATH"), *_parents(path)):
        for folder in _below(top, seen):
            if _package_name(folder) == name:
                yield folder


def _variable(name: str) -> list[str]:
    return [entry for entry in os.environ.get(name, "").split(os.pathsep) if entry]


def _parents(path: str) -> Iterator[str]:
    folder = os.path.dirname(os.path.abspath(path))
    for _ in range(_ASCENT):
        yield folder
        folder = os.path.dirname(folder)


def _below(top: str, seen: set[str]) -> Iterator[str]:
    """Yield `top` and the folders in it, level after level, without those in `seen`."""
    waiting = deque([top])
    while waiting and len(seen) < _MOST_FOLDERS:
        folder = waiting.popleft()
        real = os.path.realpath(folder)
        if real in seen:
            continue
        seen.add(real)
        yield folder
        try:
            with os.scandir(folder) as entries:
                inner = sorted(entry.path for entry in entries if entry.is_dir() and entry.name[0] != ".")
        except OSError:  # not ours to read, or removed meanwhile
            continue
        waiting.extend(inner)


def _package_name(folder: str) -> str:
    try:
        with open(os.path.join(folder, "package.xml"), encoding="utf-8") as file:
            match = re.search(r"<name>\s*([^<\s]+)\s*</name>", file.read())
            return match[1] if match else os.path.basename(folder)
    except (OSError, UnicodeDecodeError):
        return os.path.basename(folder)
