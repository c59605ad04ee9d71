"""Read mesh files of many formats: those of worlds, of vehicles, and of imported models."""

import os
import re
from typing import Any

from hil.common.errors import ConfigError
from hil.common.tables import check_file

MOST_BYTES = 256 << 20
KINDS = (".stl", ".obj", ".dae", ".glb", ".gltf", ".ply", ".off")
_HEAD = 1 << 16  # bytes of a COLLADA file, in which its unit is


def load_mesh(file: str) -> Any:
    """Return a `trimesh.Trimesh` of all that a file holds, in its own axes; COLLADA in m, others in their own unit.

    As Gazebo does, the up axis that a COLLADA file names is not heeded. Raises ConfigError for a file that is missing,
    too large, of a kind that cannot be read, or declares XML entities, ImportError without trimesh, and what trimesh's
    readers raise of damaged ones.
    """
    import trimesh

    check_file(file, MOST_BYTES)
    check_kind(file)
    ending = os.path.splitext(file)[1].lower()
    if ending == ".gltf":  # its numbers are in a file beside it
        return trimesh.load(file, force="mesh")
    with open(file, "rb") as stream:
        factor = 1.0
        if ending == ".dae":
            from sim.vehicle.urdf.text import check_xml

            data = stream.read()
            check_xml(data)
            match = re.search(rb"<unit\b[^>]*\bmeter=[\"']([0-9.eE+-]+)[\"']", data[:_HEAD])
            factor = float(match[1]) if match else 1.0
            stream.seek(0)
        # Of a stream nothing beside it is opened: no material, no texture.
        loaded: Any = trimesh.load(stream, file_type=ending[1:], force="mesh")
    if factor != 1.0:
        loaded.apply_scale(factor)
    return loaded


def check_kind(file: str) -> None:
    """Raise ConfigError for a file whose ending is that of no mesh."""
    if not file.lower().endswith(KINDS):
        raise ConfigError(f"{file}: its ending is that of no mesh that can be read: save it as {', '.join(KINDS)}")
