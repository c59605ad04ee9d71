"""Find a ROS package or a Gazebo model without ROS and Gazebo: by their environment variables, or near a file."""

import os
import re
from collections import deque
from collections.abc import Iterator
from functools import cache
from urllib.parse import unquote

# Folders of models, by Gazebo's variables.
RESOURCE_VARIABLES = (
    "GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "SDF_PATH", "GAZEBO_MODEL_PATH", "GAZEBO_RESOURCE_PATH",
)  # fmt: skip
_LEVELS_UP = 4  # folders above the file that are searched
_ABOVE_PACKAGE = 2  # folders above the file's own package that are searched, however deep in it the file is
_MAX_FOLDERS = 20_000  # that are searched below those, the nearest first: more than a workspace has, less than a disk


def find_package(name: str, path: str) -> str | None:
    """Return the first folder of `find_packages` that has a package.xml, or else the first one; None without any."""
    return min(find_packages(name, path), key=lambda folder: not _is_package(folder), default=None)


def find_packages(name: str, path: str) -> Iterator[str]:
    """Yield the folders that may be the package or model `name`, the likeliest first.

    The package that the file at `path` is in comes first. Then comes the folder NAME in those of Gazebo's variables, or
    such a folder itself or the one above it. Then the search is that of ROS: `share/NAME` in the folders of
    AMENT_PREFIX_PATH, and all folders below those of ROS_PACKAGE_PATH. Then it continues in the parents of the file and
    all folders below them. A folder is the package if its package.xml, or without one its name, says so.
    """
    yield from (folder for folder in _parents(path) if _is_package(folder) and _package_name(folder) == name)
    for top in resource_folders():
        if os.path.isdir(os.path.join(top, name)):
            yield os.path.join(top, name)
        yield from (folder for folder in (top, os.path.dirname(top)) if _package_name(folder) == name)
    for prefix in _variable("AMENT_PREFIX_PATH"):
        folder = os.path.join(prefix, "share", name)
        if os.path.isdir(folder):
            yield folder
    yield from _packages_below((*_variable("ROS_PACKAGE_PATH"), *_parents(path))).get(name, ())


@cache
def _packages_below(tops: tuple[str, ...]) -> dict[str, list[str]]:
    """Return the folders below `tops` by their names as packages; searched once in a process."""
    found: dict[str, list[str]] = {}
    visited: set[str] = set()
    for top in tops:
        for folder in _below(top, visited):
            found.setdefault(_package_name(folder), []).append(folder)
    return found


def find_file(uri: str, path: str) -> str | None:
    """Return the file of a `package://` or `model://` address in the file at `path`, None if it is not found.

    Without the package, the same path is searched in the folders above that file.
    """
    name, _, inside = unquote(uri.partition("://")[2]).partition("/")
    candidates = (os.path.join(folder, inside) for folder in (*find_packages(name, path), *_ancestors(path)))
    return next((file for file in candidates if os.path.exists(file)), None)


def resource_folders() -> list[str]:
    """Return the folders of Gazebo's environment variables."""
    return [os.path.abspath(entry) for name in RESOURCE_VARIABLES for entry in _variable(name)]


def _variable(name: str) -> list[str]:
    return [entry for entry in os.environ.get(name, "").split(os.pathsep) if entry]


def _ancestors(path: str) -> Iterator[str]:
    folder, last = os.path.dirname(os.path.abspath(path)), ""
    while folder != last:
        yield folder
        folder, last = os.path.dirname(folder), folder


def _parents(path: str) -> list[str]:
    folders = list(_ancestors(path))
    own = next((i for i, folder in enumerate(folders) if _is_package(folder)), 0)
    return folders[: max(_LEVELS_UP, own + 1 + _ABOVE_PACKAGE)]


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


def _is_package(folder: str) -> bool:
    return os.path.isfile(os.path.join(folder, "package.xml"))


def _package_name(folder: str) -> str:
    try:
        with open(os.path.join(folder, "package.xml"), encoding="utf-8") as file:
            match = re.search(r"<name>\s*([^<\s]+)\s*</name>", file.read())
            return match[1] if match else os.path.basename(folder)
    except (OSError, UnicodeDecodeError):
        return os.path.basename(folder)
