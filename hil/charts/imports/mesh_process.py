"""Measure and convert meshes; `hil.charts.imports.meshes` calls it in a separate process, within limits."""

from collections.abc import Callable, Sequence
from typing import Any

from hil.common.errors import MissingExtraError
from hil.common.tables import check_file
from sim.environment.mesh import MAX_TRIANGLES
from sim.vehicle.mesh_files import MAX_BYTES, load_mesh


def process_jobs(jobs: Sequence[dict[str, Any]], report: Callable[[dict[str, Any]], None]) -> None:
    """Report the result of each job (the keys of a `meshes.MeshJob`), as `meshes.read_meshes` returns it.

    Raises MissingExtraError.
    """
    try:
        import trimesh  # noqa: F401
    except ImportError:
        raise MissingExtraError("reading meshes needs trimesh and pycollada: pip install 'uuv-hil[mesh]'") from None
    for job in jobs:
        try:
            result = _process_job(job)
        except Exception as error:  # noqa: BLE001 - readers raise any error on damaged files
            text = str(error) if type(error).__module__.startswith("hil.") else type(error).__name__
            result = {"error": " ".join(text.split())[:200] or "no mesh that can be read"}
        report(result)


def _process_job(job: dict[str, Any]) -> dict[str, Any]:
    import numpy as np
    import trimesh

    file, matrix = job["file"], job["matrix"]
    shape = job.get("shape")
    if shape and shape["kind"] == "heightmap":
        return _heightmap(file, [float(x) for x in shape["sizes"]], job["output"])
    mesh: Any = _primitive(shape) if shape else load_mesh(file, clean=not job["output"])
    mesh.vertices = np.asarray(mesh.vertices, float) * np.asarray(job["scale"], float)
    if matrix is not None:
        mesh.vertices = mesh.vertices @ np.asarray(matrix, float)[:, :3].T + np.asarray(matrix, float)[:, 3]
    if not len(mesh.faces) or not np.isfinite(mesh.vertices).all():
        return {"error": "no triangles, or corners that are not finite numbers"}
    if job["output"]:
        if len(mesh.faces) > MAX_TRIANGLES:
            return {"error": f"{len(mesh.faces)} triangles, at most {MAX_TRIANGLES} are allowed: simplify it"}
        plain = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        plain.export(job["output"], file_type="stl")
        return {"low": mesh.bounds[0].tolist(), "high": mesh.bounds[1].tolist(), "triangles": len(mesh.faces)}
    closed = bool(mesh.is_watertight)
    solid = mesh if closed else mesh.convex_hull if len(mesh.faces) > 3 else mesh
    return {
        "volume": abs(float(mesh.volume)), "is_closed": closed, "centre": [float(x) for x in solid.center_mass],
        "low": mesh.bounds[0].tolist(), "high": mesh.bounds[1].tolist(), "triangles": len(mesh.faces),
    }  # fmt: skip


def _heightmap(file: str, sizes: list[float], output: str) -> dict[str, Any]:
    """Write the depths of a height image as little-endian floats; return the keys of its `[terrain]`, and `deepest`.

    `sizes` (m): those of the field along east, north and up, then east and north of its centre and the height of its
    darkest pixels above the water.
    """
    import numpy as np
    from PIL import Image

    check_file(file, MAX_BYTES)
    with Image.open(file) as picture:
        if picture.format not in ("PNG", "JPEG"):
            return {"error": f"a heightmap in {picture.format}: use `uuv-hil world build` to build a world of it"}
        deep = picture.mode.startswith("I")
        values = np.asarray(picture if deep else picture.convert("L"), float) / (65535.0 if deep else 255.0)
    wide, long, high, east, north, low = sizes
    rows, columns = values.shape
    step = min(wide / (columns - 1), long / (rows - 1))
    norths, easts = np.arange(0.0, long + 0.5 * step, step), np.arange(0.0, wide + 0.5 * step, step)
    depths = -(low + high * values[::-1])  # the first row of an image is the north
    depths = np.array([np.interp(easts, np.linspace(0.0, wide, columns), row) for row in depths])
    depths = np.array([np.interp(norths, np.linspace(0.0, long, rows), column) for column in depths.T]).T
    with open(output, "wb") as stream:
        stream.write(np.ascontiguousarray(depths, "<f4").tobytes())
    return {
        "north_min": north - 0.5 * long, "east_min": east - 0.5 * wide, "resolution": step,
        "rows": len(norths), "columns": len(easts), "deepest": float(depths.max()),
    }  # fmt: skip


def _primitive(shape: dict[str, Any]) -> Any:
    """Return the mesh of one of SDF's basic shapes, centred at the origin."""
    from trimesh import creation

    kind, sizes = shape["kind"], [float(x) for x in shape["sizes"]]
    makers: dict[str, Callable[[], Any]] = {
        "box": lambda: creation.box(sizes),
        "cylinder": lambda: creation.cylinder(sizes[0], sizes[1], sections=32),
        "cone": lambda: creation.cone(sizes[0], sizes[1], sections=32),
        "capsule": lambda: creation.capsule(height=sizes[1], radius=sizes[0], count=[24, 24]),
    }
    mesh: Any = makers.get(kind, lambda: creation.icosphere(subdivisions=3))()
    if kind not in makers:
        mesh.vertices *= sizes
    mesh.vertices -= mesh.bounds.mean(axis=0)
    return mesh
