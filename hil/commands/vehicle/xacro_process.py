"""Convert xacro to URDF with the package of that name, within limits on memory and time.

    python -P -m hil.commands.vehicle.xacro_process FILE.xacro [NAME:=VALUE ...]

The URDF is written to the standard output; an error in the file is the last line of standard error. xacro evaluates
the file's expressions as Python; the limits stop expressions such as `9**9**9**9`.
"""

import sys
from types import ModuleType
from typing import Any

from hil.common.children import limit_self
from hil.common.lifeline import die_with_parent
from sim.vehicle.urdf.ros_packages import find_package

MEMORY_BYTES = 2 << 30  # of address space
CPU_SECONDS = 20
DAMAGED, NO_LIBRARY = 1, 5


def main(path: str, *arguments: str) -> int:
    """Write the URDF; return the exit code."""
    die_with_parent()
    limit_self(MEMORY_BYTES, CPU_SECONDS)
    try:
        import xacro
    except ImportError:
        return NO_LIBRARY
    sys.modules.update(_package_index(path))
    try:
        text: bytes = xacro.process_file(path, mappings=dict(each.split(":=", 1) for each in arguments)).toxml("utf-8")
    except Exception as error:  # noqa: BLE001 - what an expression of the file raises
        reason = getattr(error, "exc", None) or error  # xacro wraps an expression's error and repeats its text
        *outer, inner = xacro.filestack or [path]  # the file that was being read, after those that include it
        where = f" (in {inner}, which {outer[-1]} includes)" if outer else ""
        problem = " ".join(str(reason).split()).removeprefix("[Errno 2] ")
        print((problem or type(reason).__name__) + where, file=sys.stderr)
        return DAMAGED
    sys.stdout.buffer.write(text)
    return 0


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


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
