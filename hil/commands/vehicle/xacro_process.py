"""Convert xacro to URDF with the package of that name; `xacro_expand` calls it in a separate process, within limits.

xacro evaluates the file's expressions as Python; the limits stop expressions such as `9**9**9**9`.
"""

import sys
from collections.abc import Sequence
from types import ModuleType
from typing import Any

from hil.common.errors import ConfigError, MissingExtraError
from hil.common.text import clean
from sim.vehicle.urdf.ros_packages import find_package


def convert(path: str, arguments: Sequence[str]) -> bytes:
    """Return the URDF; arguments are NAME:=VALUE. Raises ConfigError for an error in the file, MissingExtraError."""
    try:
        import xacro
    except ImportError:
        raise MissingExtraError("a xacro file needs the package xacro: pip install 'uuv-hil[master]'") from None
    sys.modules.update(_package_index(path))
    try:
        text: bytes = xacro.process_file(path, mappings=dict(each.split(":=", 1) for each in arguments)).toxml("utf-8")
    except Exception as error:  # noqa: BLE001 - what an expression of the file raises
        reason = getattr(error, "exc", None) or error  # xacro wraps an expression's error and repeats its text
        *outer, inner = xacro.filestack or [path]  # the file that was being read, after those that include it
        where = f" (in {inner}, which {outer[-1]} includes)" if outer else ""
        problem = " ".join(str(reason).split()).removeprefix("[Errno 2] ")
        raise ConfigError(f"{path}: cannot be expanded: {clean((problem or type(reason).__name__) + where)}") from None
    return text


def _package_index(path: str) -> dict[str, ModuleType]:
    """Return a replacement of `ament_index_python`, which xacro imports; it searches the folders around `path`."""

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
