"""Find a ROS package without ROS: by ROS's environment variables, or near a file."""

import os
import re
from collections import deque
from collections.abc import Iterator

_LEVELS_UP = 4  # folders above the file that are searched
_MAX_FOLDERS = 20_000  # that are searched below those, the nearest first: more than a workspace has, less than a disk


def find_package(name: str, path: str) -> str | None:
    """Return the first folder that `find_packages` yields, or None."""
    return next(find_packages(name, path), None)


def find_packages(name: str, path: str) -> Iterator[str]:
    """Yield the folders that may be the package `name`, the likeliest first.

    The search is that of ROS: `share/NAME` in the folders of AMENT_PREFIX_PATH, and all folders below those of
    ROS_PACKAGE_PATH. Then it continues in the parents of the file at `path` and all folders below them. A folder is the
    package if its package.xml, or without one its name, says so.
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
    for _ in range(_LEVELS_UP):
        yield folder
        folder = os.path.dirname(folder)


def _below(top: str, visited: set[str]) -> Iterator[str]:
    """Yield `top` and all folders below it, level by level, without those in `visited`."""
    waiting = deque([top])
    while waiting and len(visited) < _MAX_FOLDERS:
        folder = waiting.popleft()
        real = os.path.realpath(folder)
        if real in visited:
            continue
        visited.add(real)
        yield folder
        try:
            with os.scandir(folder) as entries:
                inner = sorted(entry.path for entry in entries if entry.is_dir() and entry.name[0] != ".")
        except OSError:  # no permission, or removed in the meantime
            continue
        waiting.extend(inner)


def _package_name(folder: str) -> str:
    try:
        with open(os.path.join(folder, "package.xml"), encoding="utf-8") as file:
            match = re.search(r"<name>\s*([^<\s]+)\s*</name>", file.read())
            return match[1] if match else os.path.basename(folder)
    except (OSError, UnicodeDecodeError):
        return os.path.basename(folder)
