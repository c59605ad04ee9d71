"""Measure and convert the meshes of imported models, in a separate process with limits."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from hil.charts import limited
from hil.common.text import clean
from sim.vehicle.urdf.shapes import MeshKey, Solid

LIMITS = limited.Limits(memory=3 << 30, processor=120, seconds=1200.0)


class MeshJob(NamedTuple):
    """A mesh to read, from a file or as one of SDF's basic shapes (`shape`).

    Its corners are multiplied by `scale`, then transformed by `matrix` (3 x 4: rotation and translation in m).
    `output`: the STL file to write, "" for none.
    """

    file: str
    scale: Sequence[float] = (1.0, 1.0, 1.0)
    matrix: Sequence[Sequence[float]] | None = None
    output: str = ""
    shape: Mapping[str, Any] | None = None


def read_meshes(jobs: Sequence[MeshJob]) -> list[dict[str, Any]]:
    """Return the result of each job: `low`, `high` (m), `triangles`, or `error`.

    A mesh that is not written also has `volume`, `centre` and `is_closed`.
    A file that exceeds the limits of the process gets an `error`; the other jobs are continued in a new process.
    Raises MissingExtraError.
    """
    results: list[dict[str, Any]] = []
    while len(results) < len(jobs):
        left = [job._asdict() for job in jobs[len(results) :]]
        try:
            limited.call("hil.charts.imports.mesh_process:process_jobs", left, limits=LIMITS, report=results.append)
        except limited.EndedError:
            results.append({"error": "takes too much time or memory"})
    return results


def measure(meshes: Sequence[MeshKey], notes: list[str]) -> dict[MeshKey, Solid]:
    """Return volume and bounding box of each mesh (file, scale); errors are appended to `notes`."""
    if not meshes:
        return {}
    solids = {}
    for key, result in zip(meshes, read_meshes([MeshJob(file, scale) for file, scale in meshes]), strict=True):
        if key[0].startswith(("package://", "model://")):
            notes.append(
                f"The mesh {clean(key[0])} is not near the file: name its folder by ROS_PACKAGE_PATH or "
                "GZ_SIM_RESOURCE_PATH."
            )
        elif "error" in result:
            notes.append(f"The mesh {clean(key[0])} cannot be measured: {clean(result['error'])}.")
        else:
            centre, low, high = (tuple(result[corner]) for corner in ("centre", "low", "high"))
            solids[key] = Solid(result["volume"], centre, low, high, result["is_closed"])
    return solids
