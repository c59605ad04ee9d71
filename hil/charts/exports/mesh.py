"""Export a grid as triangles: STL and GLB."""

import json
import struct

import numpy as np
from numpy.typing import NDArray

from hil.charts.grid import Grid, round_up, write_file
from hil.common.errors import ConfigError

Corners = NDArray[np.float32]
Triangles = NDArray[np.uint32]

MAX_NODES = 4_000_000  # of a mesh: 8 million triangles, 0.4 GB as STL; making it takes a few times that memory
_SAND = {"baseColorFactor": [0.76, 0.7, 0.5, 1.0], "metallicFactor": 0.0}


def check_size(grid: Grid) -> None:
    """Raise ConfigError if a mesh of `grid` would have more than MAX_NODES nodes, too many for memory."""
    rows, columns = grid.depths.shape
    if rows * columns > MAX_NODES:
        suggested = round_up(grid.resolution * (rows * columns / MAX_NODES) ** 0.5 * 1.001)
        raise ConfigError(
            f"--resolution: {grid.resolution:g} m makes a mesh of {rows} x {columns} nodes, more than {MAX_NODES}: "
            f"use {suggested:g} m or coarser"
        )


def triangulate(grid: Grid) -> tuple[Corners, Triangles]:
    """Return corners (n, 3) east, north, up in m, and triangles (m, 3) of their indices, counter-clockwise from above.

    A cell has two triangles, or none if one of its nodes is unknown. Raises ConfigError if there are no triangles, or
    more nodes than MAX_NODES.
    """
    check_size(grid)
    rows, columns = grid.depths.shape
    north, east = np.meshgrid(grid.north, grid.east, indexing="ij")
    corners = np.stack([east, north, -grid.depths], axis=-1).reshape(-1, 3).astype(np.float32)
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    here, right, above, across = first, first + 1, first + columns, first + columns + 1
    triangles = np.concatenate([np.column_stack([here, right, across]), np.column_stack([here, across, above])])
    triangles = triangles[np.isfinite(corners[triangles, 2]).all(axis=1)]
    if not len(triangles):
        raise ConfigError("the world has no cell with four known depths, so it has no mesh: choose another world")
    used, renumbered = np.unique(triangles, return_inverse=True)
    return corners[used], renumbered.reshape(-1, 3).astype(np.uint32)


def write_stl(grid: Grid, path: str) -> None:
    """Write a binary STL; x east, y north, z up, in m. Raises ConfigError."""
    corners, triangles = triangulate(grid)
    faces = corners[triangles]
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    rows = np.zeros(len(faces), np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]))
    rows["normal"], rows["corners"] = normals, faces
    write_file(path, b"seabed, m, x east y north z up".ljust(80) + struct.pack("<I", len(rows)) + rows.tobytes())


def write_glb(grid: Grid, path: str) -> None:
    """Write a binary glTF 2.0, whose axes are x east, y up, z south, in m. Raises ConfigError."""
    corners, triangles = triangulate(grid)
    vertices = np.column_stack([corners[:, 0], corners[:, 2], -corners[:, 1]]).astype("<f4")
    points, indices = vertices.tobytes(), triangles.astype("<u4").tobytes()
    scene = {
        "asset": {"version": "2.0", "generator": "uuv-hil"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "seabed", "mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": _SAND, "doubleSided": True}],
        "accessors": [
            {
                "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": len(vertices),
                "min": vertices.min(axis=0).tolist(), "max": vertices.max(axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": 5125, "type": "SCALAR", "count": triangles.size},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(points), "target": 34962},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(indices), "target": 34963},
        ],
        "buffers": [{"byteLength": len(points) + len(indices)}],
    }  # fmt: skip
    text = json.dumps(scene, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    body = points + indices
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(body), b"BIN\0") + body
    write_file(path, struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
