"""Read and grid seabed files in a separate process, within limits on memory and time, because they may be damaged."""

import os
from collections.abc import Sequence
from importlib.util import find_spec

from hil.charts import limited
from hil.charts.build import MAX_NODES, BuiltSeabed, build, default_resolution, size_of
from hil.charts.chart_survey import GeoBox
from hil.charts.grid import Extent
from hil.charts.gridding import Progress
from hil.charts.sources.combine import ReadOptions, read_sources
from hil.charts.sources.survey import Survey
from hil.common.children import limit_self
from hil.common.errors import ConfigError, HilError, MissingExtraError

# Address space: of the libraries, and of a node and a point of the data, about twice what a build takes
MEMORY_BYTES, NODE_BYTES, POINT_BYTES = 600 << 20, 200, 4000
RASTER_BYTES = 2 << 30  # for reading rasters, whose blocks may be large
# Processor time: of the start, a node and a point, about ten times what a build takes on a PC: a board is slower
CPU_SECONDS, NODE_SECONDS, POINT_SECONDS = 60.0, 40e-6, 5e-3
MAX_CPU_SECONDS = 7200


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
    job = list(paths), area, resolution, options._replace(priorities=dict(options.priorities))
    limits = limited.Limits(_memory(MAX_NODES, 0) + RASTER_BYTES, MAX_CPU_SECONDS)
    try:
        built: tuple[Survey, BuiltSeabed] = limited.call(
            f"{__name__}:build_files", *job, limits=limits, report=progress
        )
    except limited.EndedError:
        raise ConfigError(
            f"{', '.join(paths)}: gridding was ended, as it took too much time or memory: the file is damaged, or use "
            "a coarser --resolution or a smaller area"
        ) from None
    return built


def build_files(
    paths: list[str], area: GeoBox | None, resolution: float | None, options: ReadOptions, report: Progress
) -> tuple[Survey, BuiltSeabed]:
    """Return what `read_and_build` does, from this process, which is limited to what it needs. Raises HilError."""
    try:
        survey, extent = read_sources(paths, area, resolution, options)
        _limit(survey, extent, resolution)
        return survey._replace(beds=(), fillers=()), build(survey, extent, resolution, report)
    except (HilError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001 - libraries raise any error on damaged data
        text = " ".join(str(error).split())[:200]
        what = f"damaged ({type(error).__name__}: {text}); copy it again"
        raise ConfigError(f"{', '.join(paths)}: {what}") from None


def _limit(survey: Survey, extent: Extent, resolution: float | None) -> None:
    """Limit this process to what the data of `survey` and the nodes of their grid need."""
    nodes = min(MAX_NODES, int(size_of(extent) / (resolution or default_resolution(survey, extent)) ** 2))
    points = len(survey.soundings) + len(survey.guides) + len(survey.strikes)
    rasters = RASTER_BYTES if survey.beds or survey.fillers else 0
    seconds = CPU_SECONDS + NODE_SECONDS * nodes + POINT_SECONDS * points
    limit_self(_memory(nodes, points) + rasters, min(MAX_CPU_SECONDS, int(seconds + sum(os.times()[:2]))))


def _memory(nodes: int, points: int) -> int:
    return MEMORY_BYTES + NODE_BYTES * nodes + POINT_BYTES * points
