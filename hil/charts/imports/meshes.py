"""Measure and convert the meshes of imported models, in a process of its own with limits."""

import json
import subprocess
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from hil.charts.imports.mesh_process import CPU_SECONDS, NO_LIBRARY
from hil.common.children import module_command, package_environment, start_child
from hil.common.errors import MissingExtraError
from hil.common.text import clean
from sim.vehicle.urdf.shapes import MeshKey, Solid

MAX_SECONDS = 10.0 * CPU_SECONDS


class MeshJob(NamedTuple):
    """A mesh to read: its file or one of SDF's shapes, what its numbers are multiplied with, then turned and moved by.

    `matrix` is 3 x 4 (m); `output` the STL file to write, "" for none.
    """

    file: str
    scale: Sequence[float] = (1.0, 1.0, 1.0)
    matrix: Sequence[Sequence[float]] | None = None
    output: str = ""
    shape: Mapping[str, Any] | None = None


def read_meshes(jobs: Sequence[MeshJob]) -> list[dict[str, Any]]:
    """Return an answer to each job: `volume`, `centre`, `low`, `high` (m), `triangles` and `is_closed`, or `error`.

    A file that ends the process at its limits has an error of its own. Raises MissingExtraError.
    """
    answers: list[dict[str, Any]] = []
    while len(answers) < len(jobs):
        lines, code = _run(jobs[len(answers) :])
        answers += [json.loads(line) for line in lines]
        if code == NO_LIBRARY:
            raise MissingExtraError("reading meshes needs trimesh and pycollada: pip install 'uuv-hil[mesh]'")
        if len(answers) < len(jobs):
            answers.append({"error": "takes too much time or memory"})
    return answers


def measure(meshes: Sequence[MeshKey], notes: list[str]) -> dict[MeshKey, Solid]:
    """Return volume and box of each mesh (file, scale); `notes` takes those that cannot be read."""
    if not meshes:
        return {}
    found = {}
    for key, answer in zip(meshes, read_meshes([MeshJob(file, scale) for file, scale in meshes]), strict=True):
        if "error" in answer:
            notes.append(f"The mesh {clean(key[0])} cannot be measured: {clean(answer['error'])}.")
        else:
            centre, low, high = (tuple(answer[corner]) for corner in ("centre", "low", "high"))
            found[key] = Solid(answer["volume"], centre, low, high, answer["is_closed"])
    return found


def _run(jobs: Sequence[MeshJob]) -> tuple[list[str], int]:
    """Return the lines that the process wrote, and its exit code."""
    command = module_command("hil.charts.imports.mesh_process")
    text = json.dumps([job._asdict() for job in jobs]).encode()
    with start_child(
        command, environment=package_environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        try:
            output, _ = process.communicate(text, timeout=MAX_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            output, _ = process.communicate()
        finally:
            process.kill()  # does nothing to one that has ended
    return [line for line in output.decode().splitlines() if line.endswith("}")], process.returncode
