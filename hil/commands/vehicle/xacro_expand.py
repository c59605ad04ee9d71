"""Convert xacro to URDF with the package of that name; `$(find PACKAGE)` works without ROS."""

import re
import sys
from collections.abc import Iterable
from types import ModuleType
from typing import Any

from hil.common.errors import ConfigError, MissingExtraError
from hil.common.tables import read_bytes
from sim.vehicle.urdf.ros_packages import find_package


def is_xacro(path: str) -> bool:
    """True if the file at `path` uses xacro's namespace or is named for it; False too if it cannot be read."""
    try:
        return b"/wiki/xacro" in read_bytes(path) or path.endswith(".xacro")
    except ConfigError:
        return False


def expand(path: str, arguments: Iterable[str] = ()) -> bytes:
    """Return the URDF that the xacro file at `path` makes; `arguments` are NAME=VALUE or, as in ROS, NAME:=VALUE.

    `$(find PACKAGE)` is looked for as sim/vehicle/urdf/ros_packages.py says. xacro evaluates expressions of the file
    as Python:
    expand files you trust. Raises ConfigError, MissingExtraError.
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
    """Return what xacro asks for packages, answered from the folders around `path`."""

    def share(name: str) -> str:
        folder = find_package(name, path)
        if folder is None:
            raise LookupError(
                f"no package {name!r} by AMENT_PREFIX_PATH, by ROS_PACKAGE_PATH or in the folders around {path}; "
                f"give its path instead of $(find {name})"
            )
        return folder

    package, packages = ModuleType("ament_index_python"), ModuleType("ament_index_python.packages")
    for module in (package, packages):
        stand_in: Any = module
        stand_in.get_package_share_directory = share
        stand_in.PackageNotFoundError = LookupError
    package.packages = packages  # type: ignore[attr-defined]
    return {"ament_index_python": package, "ament_index_python.packages": packages}
