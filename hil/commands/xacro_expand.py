"""From xacro to URDF, by the package of that name; `$(find PACKAGE)` works without ROS."""

import os
import re
import sys
from collections.abc import Iterable, Iterator
from types import ModuleType
from typing import Any

from hil.errors import ConfigError, MissingExtraError

_ASCENT, _DESCENT = 4, 2  # how many folders up from the file, and down from each, a package is looked for


def is_xacro(path: str) -> bool:
    """True if the file at `path` uses xacro's namespace or is named for it; False too if it cannot be read."""
    try:
        with open(path, "rb") as file:
            return path.endswith(".xacro") or b"/wiki/xacro" in file.read()
    except OSError:
        return False


def expand(path: str, arguments: Iterable[str] = ()) -> bytes:
    """The URDF that the xacro file at `path` makes; `arguments` are NAME=VALUE or, as in ROS, NAME:=VALUE.

    `$(find PACKAGE)` is a folder near the file, one of its parents or below one of them, that is named PACKAGE
    or whose package.xml is. xacro evaluates expressions of the file as Python: expand files you trust.
    Raises ConfigError, MissingExtraError.
    """
    try:
        import xacro
    except ImportError:
        raise MissingExtraError("a xacro file needs the package xacro: pip install 'uuv-hil[master]'") from None
    mappings = dict(_pair(argument) for argument in arguments)
    before = {name: sys.modules.get(name) for name in ("ament_index_python", "ament_index_python.packages")}
    sys.modules.update(_package_index(path))
    try:
        text: bytes = xacro.process_file(path, mappings=mappings).toxml(encoding="utf-8")
    except Exception as error:
        reason = getattr(error, "exc", None) or error  # xacro wraps what an expression raised, and says it twice
        raise ConfigError(f"{path}: cannot be expanded: {' '.join(str(reason).split())}") from error
    finally:
        for name, module in before.items():
            sys.modules.pop(name)
            if module is not None:
                sys.modules[name] = module
    return text


def _pair(argument: str) -> tuple[str, str]:
    name, sign, value = re.split(r"(:?=)", argument, maxsplit=1) if "=" in argument else (argument, "", "")
    if not (name and sign):
        raise ConfigError(f"xacro argument {argument!r}: write NAME=VALUE")
    return name, value


def _package_index(path: str) -> dict[str, ModuleType]:
    """What xacro asks for packages, answered from the folders around `path`."""

    def share(name: str) -> str:
        for folder in _folders_near(path):
            if _package_name(folder) == name:
                return folder
        raise LookupError(f"no package {name!r} in the folders around {path}; give its path instead of $(find {name})")

    package, packages = ModuleType("ament_index_python"), ModuleType("ament_index_python.packages")
    for module in (package, packages):
        found: Any = module
        found.get_package_share_directory = share
        found.PackageNotFoundError = LookupError
    package.packages = packages  # type: ignore[attr-defined]
    return {"ament_index_python": package, "ament_index_python.packages": packages}


def _folders_near(path: str) -> Iterator[str]:
    """The parents of a file from the nearest up, each followed by the folders in it, down to `_DESCENT`."""
    folder = os.path.dirname(os.path.abspath(path))
    for _ in range(_ASCENT):
        for place, inner, _files in os.walk(folder):
            inner[:] = sorted(name for name in inner if not name.startswith("."))
            if os.path.relpath(place, folder).count(os.path.sep) >= _DESCENT - 1:
                inner.clear()
            yield place
        folder = os.path.dirname(folder)


def _package_name(folder: str) -> str:
    try:
        with open(os.path.join(folder, "package.xml"), encoding="utf-8") as file:
            found = re.search(r"<name>\s*([^<\s]+)\s*</name>", file.read())
            return found[1] if found else os.path.basename(folder)
    except (OSError, UnicodeDecodeError):
        return os.path.basename(folder)
