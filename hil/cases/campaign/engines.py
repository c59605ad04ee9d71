"""Engines that run a campaign: joblib on this machine, or a cluster of Dask or Ray.

Each yields a result when its run ends, so that progress can be shown. A run is sent to a cluster with the contents of
the scenario's files; workers need the same version of this project.
"""

import logging
import os
import socket
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from importlib import import_module
from typing import Any, NamedTuple

from hil.cases.campaign.files import Bundle, unpack
from hil.common.children import worker_options
from hil.common.errors import ConfigError, HilError, MissingExtraError, NetworkError
from hil.common.scratch import ScratchFolder
from hil.common.stop import ctrl_c_held_back, every_end_like_ctrl_c

DASK_ADDRESS, RAY_ADDRESS = "DASK_SCHEDULER_ADDRESS", "RAY_ADDRESS"
CLUSTERS = {"dask": DASK_ADDRESS, "ray": RAY_ADDRESS}  # backend -> the variable that names the cluster
DIAL_S = 3.0  # timeout of the check that a cluster's address answers

Changes = dict[str, Any]
Row = dict[str, Any]


class Task(NamedTuple):
    """One run: its number, what is changed in the scenario, and its seed."""

    number: int
    changes: Changes
    seed: int


Run = Callable[[str, Changes, int], Row]  # of the scenario of that name
Result = tuple[int, Row]


def run_here(run: Run, scenario: str, tasks: Sequence[Task], jobs: int, backend: str) -> Generator[Result, None, None]:
    """Run the tasks by joblib's `backend`, in so many processes. Raises MissingExtraError, ConfigError."""
    try:
        import joblib
    except ImportError:
        raise MissingExtraError("a campaign needs joblib: pip install 'uuv-hil[master]'") from None
    try:
        chosen = joblib.parallel_config(backend=backend, n_jobs=jobs)
    except ValueError as error:
        raise ConfigError(f"--backend {backend!r}: {error}; dask and ray are available too") from None
    # Worker processes of joblib itself end with this process.
    workers: AbstractContextManager[dict[str, Any]] = worker_options() if backend == "loky" else nullcontext({})
    with chosen, workers as options:
        calls = (joblib.delayed(_run_named)(run, scenario, task) for task in tasks)
        with ctrl_c_held_back():  # this process ends its workers
            results = joblib.Parallel(return_as="generator_unordered", **options)(calls)
        yield from results


def cluster_of(backend: str) -> str:
    """Return the address of the cluster that the environment names for a backend in CLUSTERS; "" if it names none.

    None is started here: its ports would let other accounts of this machine run programs as this user.
    """
    address = os.environ.get(CLUSTERS[backend], "")
    return "" if address == "local" else address


def run_on_cluster(
    run: Run, bundle: Bundle, tasks: Sequence[Task], jobs: int, backend: str
) -> Generator[Result, None, None]:
    """Run the tasks on the cluster that the environment names; yield the results.

    At most `jobs` runs go at once, -1: all. Raises MissingExtraError, NetworkError, ConfigError.
    """
    try:
        with (_dask if backend == "dask" else _ray)() as engine:
            shared = engine.share(bundle)
            waiting, limit = list(reversed(tasks)), jobs if jobs > 0 else len(tasks)
            running: list[Any] = []
            while waiting or running:
                while waiting and len(running) < limit:
                    running.append(engine.submit(_run_unpacked, run, shared, waiting.pop()))
                done, running = engine.wait(running)
                for result in done:
                    yield engine.result(result)
    except ImportError:
        raise MissingExtraError(f"--backend {backend} needs its package: pip install 'uuv-hil[cluster]'") from None
    except (HilError, KeyboardInterrupt, GeneratorExit):
        raise
    except Exception as error:  # of the cluster, each in a class of its own  # noqa: BLE001
        reason = (str(error).strip() or "no reason given").splitlines()
        remedy = "its log says more; every worker needs the same version of uuv-hil and Python"
        if backend == "ray" and "RAY_AUTH_MODE" not in os.environ:
            remedy += "; a cluster with a token needs RAY_AUTH_MODE=token and its head's ~/.ray/auth_token"
        raise NetworkError(f"--backend {backend}: {type(error).__name__}: {reason[0]}; {remedy}") from None


class _Engine(NamedTuple):
    """The part of a cluster that a campaign needs: `wait` returns the finished tasks and the others."""

    share: Callable[[Bundle], Any]
    submit: Callable[..., Any]
    wait: Callable[[list[Any]], tuple[list[Any], list[Any]]]
    result: Callable[[Any], Result]


@contextmanager
def _dask() -> Iterator[_Engine]:
    distributed = import_module("distributed")
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # errors are reported in one line
    address = os.environ[DASK_ADDRESS]
    _check_scheduler("dask", DASK_ADDRESS, address, "start it with `dask scheduler`")
    client = distributed.Client(address, timeout=4 * DIAL_S)

    def wait(running: list[Any]) -> tuple[list[Any], list[Any]]:
        done, others = distributed.wait(running, return_when="FIRST_COMPLETED")
        return list(done), list(others)

    try:
        if not client.scheduler_info()["workers"]:
            raise NetworkError(f"{DASK_ADDRESS}={address}: the scheduler has no workers; start `dask worker {address}`")
        yield _Engine(
            share=lambda bundle: client.scatter([bundle], broadcast=True)[0],
            submit=lambda *task: client.submit(*task, pure=False),
            wait=wait,
            result=lambda future: future.result(),
        )
    finally:
        client.close()


@contextmanager
def _ray() -> Iterator[_Engine]:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # no usage reports to Ray's makers
    ray = import_module("ray")
    address = os.environ[RAY_ADDRESS]
    if address != "auto":
        _check_scheduler("ray", RAY_ADDRESS, address, "start it with `ray start --head`")
    here = os.getcwd()
    with ScratchFolder("ray") as empty:
        try:
            os.chdir(empty.path)  # workers put the current folder first on their path, before our own modules
            ray.init(address=address, logging_level="ERROR", log_to_driver=False)
        finally:
            os.chdir(here)
    remote = ray.remote(_call)
    try:
        with every_end_like_ctrl_c():  # it has set handlers of its own
            yield _Engine(share=ray.put, submit=remote.remote, wait=ray.wait, result=ray.get)
    finally:
        ray.shutdown()


def _call(function: Callable[..., Result], *arguments: Any) -> Result:
    return function(*arguments)


def _check_scheduler(backend: str, variable: str, address: str, remedy: str) -> None:
    """Check that a scheduler answers at its address. Raises NetworkError at once; the library's error takes minutes.

    Raises ConfigError for what is no address.
    """
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if not host or not (port.isascii() and port.isdigit() and 0 < int(port) < 65_536):
        raise ConfigError(f"{variable}={address!r}: expected HOST:PORT, for example tcp://10.0.0.5:8786")
    try:
        socket.create_connection((host.strip("[]"), int(port)), DIAL_S).close()
    except OSError as error:
        reason = error.strerror or str(error)
        raise NetworkError(
            f"--backend {backend}: no scheduler answers at {variable}={address}: {reason}; {remedy}, or unset "
            f"{variable} to run on this machine"
        ) from None


def _run_named(run: Run, scenario: str, task: Task) -> Result:
    return task.number, run(scenario, task.changes, task.seed)


def _run_unpacked(run: Run, bundle: Bundle, task: Task) -> Result:
    """Run one mission on a worker, after its scenario's files are written there."""
    unpacked = unpack(bundle)
    row = run(unpacked.scenario, unpacked.moved(task.changes), task.seed)
    return task.number, row | task.changes | {"reason": unpacked.as_named(row["reason"])}
