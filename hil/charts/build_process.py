"""Read and grid seabed files in a separate process, within limits on memory and time, because they may be damaged.

    python -P -m hil.charts.build_process < JOB

JOB is pickled: the arguments of `hil.charts.sources.combine.read_sources`. The process writes lines with its progress,
then one with the kind of the result ("built", or the name of an error), then the result, pickled.
"""

import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib.util import find_spec
from typing import IO, Any, cast

from hil.charts.build import MAX_NODES, BuiltSeabed, build, default_resolution, size_of
from hil.charts.chart_survey import GeoBox
from hil.charts.grid import Extent
from hil.charts.gridding import Progress
from hil.charts.sources.combine import ReadOptions, read_sources
from hil.charts.sources.survey import Survey
from hil.common import errors
from hil.common.children import limit_self, module_command, package_environment, start_child
from hil.common.errors import ConfigError, HilError, MissingExtraError
from hil.common.lifeline import die_with_parent

# Address space: of the libraries, and of a node and a point of the data, about twice what a build takes
MEMORY_BYTES, NODE_BYTES, POINT_BYTES = 600 << 20, 200, 4000
RASTER_BYTES = 2 << 30  # for reading rasters, whose blocks may be large
# Processor time: of the start, a node and a point, about ten times what a build takes on a PC: a board is slower
CPU_SECONDS, NODE_SECONDS, POINT_SECONDS = 60.0, 40e-6, 5e-3
MAX_CPU_SECONDS = 7200
BUILT = "built"


def read_and_build(
    paths: Sequence[str], area: GeoBox | None = None, resolution: float | None = None,
    options: ReadOptions = ReadOptions(), progress: Progress = lambda share: None,
) -> tuple[Survey, BuiltSeabed]:  # fmt: skip
    """Return the combined data of the files, without their rasters, and the seabed gridded from them.

    Arguments as of `read_sources` and `build`. Raises HilError, also at a limit on memory or time.
    """
    missing = [name for name in ("scipy", "pygeomag") if find_spec(name) is None]  # write_world needs pygeomag
    if missing:
        raise MissingExtraError(f"a world of charts needs {' and '.join(missing)}: pip install 'uuv-hil[chart]'")
    job = pickle.dumps((list(paths), area, resolution, options._replace(priorities=dict(options.priorities))))
    environment = {**package_environment(), "OPENBLAS_NUM_THREADS": "1"}
    with start_child(
        module_command("hil.charts.build_process"), environment=environment,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    ) as process:  # fmt: skip
        try:
            with suppress(BrokenPipeError), cast(IO[bytes], process.stdin) as stdin:  # it has ended already
                stdin.write(job)
            kind, result = _receive(process.stdout, progress)
        finally:
            process.kill()  # has no effect if the process has ended
    if kind == BUILT:
        return result  # type: ignore[no-any-return]
    if kind:
        raise getattr(errors, kind)(result)
    raise ConfigError(
        f"{', '.join(paths)}: gridding was ended, as it took too much time or memory: the file is damaged, or use a "
        "coarser --resolution or a smaller area"
    )


def _receive(stream: Any, progress: Progress) -> tuple[str, Any]:
    """Report the progress in `stream`; return the kind of the result and the result, "" and None if there is none."""
    for line in stream:
        word = line.decode().strip()
        if word[:1].isalpha():
            try:
                return word, pickle.load(stream)
            except (EOFError, pickle.UnpicklingError):  # ended while it wrote
                break
        progress(float(word))
    return "", None


def main() -> int:
    """Read and grid as the job says; write the result and return the exit code."""
    die_with_parent()
    output, sys.stdout = sys.stdout.buffer, sys.stderr  # libraries may print
    limit_self(_memory(MAX_NODES, 0) + RASTER_BYTES, MAX_CPU_SECONDS)
    paths, area, resolution, options = pickle.load(sys.stdin.buffer)
    kind: str
    result: Any
    try:
        survey, extent = read_sources(paths, area, resolution, options)
        _limit(survey, extent, resolution)
        built = build(survey, extent, resolution, lambda share: _write(output, f"{share:.3f}"))
        kind, result = BUILT, (survey._replace(beds=(), fillers=()), built)
    except HilError as error:
        kind, result = type(error).__name__, str(error)
    except MemoryError:
        return 1
    except Exception as error:  # noqa: BLE001 - libraries raise any error on damaged data
        text = " ".join(str(error).split())[:200]
        kind, result = "ConfigError", f"{', '.join(paths)}: damaged ({type(error).__name__}: {text}); copy it again"
    _write(output, kind)
    pickle.dump(result, output, pickle.HIGHEST_PROTOCOL)
    return 0


def _limit(survey: Survey, extent: Extent, resolution: float | None) -> None:
    """Limit this process to what the data of `survey` and the nodes of their grid need."""
    nodes = min(MAX_NODES, int(size_of(extent) / (resolution or default_resolution(survey, extent)) ** 2))
    points = len(survey.soundings) + len(survey.guides) + len(survey.strikes)
    rasters = RASTER_BYTES if survey.beds or survey.fillers else 0
    seconds = CPU_SECONDS + NODE_SECONDS * nodes + POINT_SECONDS * points
    limit_self(_memory(nodes, points) + rasters, min(MAX_CPU_SECONDS, int(seconds + sum(os.times()[:2]))))


def _memory(nodes: int, points: int) -> int:
    return MEMORY_BYTES + NODE_BYTES * nodes + POINT_BYTES * points


def _write(output: Any, word: str) -> None:
    output.write(word.encode() + b"\n")
    output.flush()


if __name__ == "__main__":
    sys.exit(main())
