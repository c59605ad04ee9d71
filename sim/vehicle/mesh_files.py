"""Read mesh files of worlds, vehicles and imported models, in several formats."""

import os
import re
from typing import Any

from hil.common.errors import ConfigError
from hil.common.tables import check_file

MAX_BYTES = 256 << 20
KINDS = (".stl", ".obj", ".dae", ".glb", ".gltf", ".ply", ".off")
_HEAD = 1 << 16  # first bytes of a COLLADA file, which contain its unit


def load_mesh(file: str, clean: bool = True) -> Any:
    """Return all meshes of a file as one `trimesh.Trimesh`, in the file's axes; COLLADA in m, others in their own unit.

    With `clean` equal corners become one, and triangles with corners that are no numbers are left out. The up axis of
    a COLLADA file is ignored, as Gazebo does. No materials or textures are read from other files. Raises ConfigError
    for a file that is missing, too large, of an unknown format, or that declares XML entities; ImportError without
    trimesh; and the errors of trimesh's readers for damaged files.
    """
    return _load(file, None, force="mesh", process=clean)


def load_parts(file: str, with_materials: bool) -> list[Any]:
    """Return the meshes of a file; axes, unit and errors as of `load_mesh`.

    With materials, materials and textures in other files are read if these are in the file's folder or below it.
    """
    resolver = None
    if with_materials:
        from sim.vehicle.mesh_materials import FolderResolver

        resolver = FolderResolver(file)
    loaded = _load(file, resolver, process=False)
    return list(loaded.dump()) if hasattr(loaded, "dump") else [loaded]


def _load(file: str, resolver: Any, **options: Any) -> Any:
    import trimesh

    check_file(file, MAX_BYTES)
    check_kind(file)
    ending = os.path.splitext(file)[1].lower()
    if ending == ".gltf":  # its vertices are in a file beside it
        return trimesh.load(file, **options)
    with open(file, "rb") as stream:
        factor = 1.0
        if ending == ".dae":
            from sim.vehicle.urdf.text import check_xml

            data = stream.read()
            check_xml(data)
            match = re.search(rb"<unit\b[^>]*\bmeter=[\"']([0-9.eE+-]+)[\"']", data[:_HEAD])
            factor = float(match[1]) if match else 1.0
            stream.seek(0)
        # From a stream without a resolver trimesh opens no further files.
        loaded: Any = trimesh.load(stream, file_type=ending[1:], resolver=resolver, **options)
    if factor != 1.0:
        loaded.apply_scale(factor)
    return loaded


def check_kind(file: str) -> None:
    """Raise ConfigError for a file whose extension is that of no known mesh format."""
    if not file.lower().endswith(KINDS):
        raise ConfigError(f"{file}: its ending is that of no mesh that can be read: save it as {', '.join(KINDS)}")
