"""Simulate many runs at once, on all processors of this machine, by joblib."""

from collections.abc import Callable, Generator, Sequence
from typing import Any, TypeVar

from hil.common.children import worker_options
from hil.common.errors import MissingExtraError
from hil.common.stop import ctrl_c_held_back

Result = TypeVar("Result")


def run_parallel(
    run: Callable[..., Result], tasks: Sequence[tuple[Any, ...]], jobs: int
) -> Generator[Result, None, None]:
    """Call `run` with each task's arguments, in `jobs` processes (-1: one a processor); yield each result as it comes.

    The processes end with this one. Raises MissingExtraError.
    """
    try:
        import joblib
    except ImportError:
        raise MissingExtraError("many runs at once need joblib: pip install 'uuv-hil[master]'") from None
    with worker_options() as options:
        with ctrl_c_held_back():  # this process ends its workers
            calls = (joblib.delayed(run)(*task) for task in tasks)
            results = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered", **options)(calls)
        yield from results
