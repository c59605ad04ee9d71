"""Send the files of a scenario to workers on other machines by content."""

import atexit
import hashlib
import os
import sys
import sysconfig
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from hil.common import __version__
from hil.common.errors import ConfigError
from hil.common.plugins import loaded
from hil.common.schema import preset_folder
from hil.common.scratch import ScratchFolder
from hil.master.flight import make_planner, make_request
from hil.scenario.config import build_simulation, load_scenario
from hil.slave.pilot import build_pilot
from sim.environment.world import load_world
from sim.vehicle.vehicle import load_vehicle

PACKAGES = ("hil", "sim", "boards", "firmware_stub")
WITH_PATHS = (".toml", ".yaml")  # files that may name others


class Bundle(NamedTuple):
    """Files that a worker needs besides this project: `scenario` as it was named, `files` by their absolute paths.

    `modules` are names of modules of the user's own, and `folders` where they are found. `version` is ours. Names of
    files are those of `current_folder`, where the bundle was made.
    """

    scenario: str
    files: Mapping[str, bytes]
    modules: tuple[str, ...]
    folders: tuple[str, ...]
    version: str
    current_folder: str

    @property
    def digest(self) -> str:
        """Digest of the content; equal for bundles of equal content."""
        parts = [
            self.scenario,
            self.current_folder,
            *[f"{path}\0{hashlib.sha256(data).hexdigest()}" for path, data in self.files.items()],
        ]
        return hashlib.sha256("\0".join([*parts, *self.modules, *self.folders]).encode()).hexdigest()

    def bundled_path(self, name: str) -> str:
        """Return the absolute path of a bundled file, by its name in `current_folder`; "" if it is not bundled."""
        path = os.path.normpath(os.path.join(self.current_folder, name))
        return path if path in self.files else ""


def collect(scenario: str, sets: Sequence[Mapping[str, Any]]) -> Bundle:
    """Collect all files that runs of a scenario with these changes read, except installed ones. Raises HilError.

    It builds each vehicle and records which files are opened, so that it finds every kind of file that a scenario, a
    vehicle or a world can name.
    """
    with _opened_files() as opened:
        for changes in sets:
            _build(scenario, dict(changes))
    own = _own_modules()
    paths = {path for path in opened if not _is_installed(path)} | set(own.values())
    files = {}
    for path in sorted(paths):
        if os.path.isfile(path) and not path.endswith(".pyc"):
            with open(path, "rb") as file:
                files[path] = file.read()
    folders = [folder for folder in map(os.path.abspath, sys.path) if any(p.startswith(f"{folder}/") for p in paths)]
    return Bundle(scenario, files, tuple(own), tuple(folders) if own else (), __version__, os.getcwd())


def unpack(bundle: Bundle) -> "Unpacked":
    """Return the files in a folder of this process, which stays until another bundle comes or the process ends.

    Raises ConfigError if uuv-hil here is of another version than where the bundle was made.
    """
    if bundle.version != __version__:
        raise ConfigError(
            f"this worker has uuv-hil {__version__}, and the campaign was started by {bundle.version}: "
            "install the same version on both"
        )
    digest = bundle.digest
    if _Cache.digest != digest:
        _Cache.clear()
        _Cache.unpacked = _write(bundle)
        _Cache.digest = digest
    assert _Cache.unpacked
    return _Cache.unpacked


class Unpacked(NamedTuple):
    """Files of a bundle below `root`; `scenario` is what to load, `named` what the user called it."""

    root: str
    scenario: str
    bundle: Bundle

    def moved(self, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return changes of the scenario with the paths of bundled files replaced by their unpacked paths."""
        paths = {
            key: self.bundle.bundled_path(value) if isinstance(value, str) else "" for key, value in changes.items()
        }
        return {key: self.root + paths[key] if paths[key] else value for key, value in changes.items()}

    def as_named(self, text: str) -> str:
        """Return a message with the paths as the user wrote them."""
        return text.replace(self.scenario, self.bundle.scenario).replace(self.root, "")


class _Cache:
    """Bundles that this process has unpacked."""

    digest = ""
    unpacked: Unpacked | None = None
    folder: ScratchFolder | None = None
    modules: tuple[str, ...] = ()
    folders: tuple[str, ...] = ()

    @classmethod
    def clear(cls) -> None:
        for name in cls.modules:  # another campaign may have other content under these names
            sys.modules.pop(name, None)
        sys.path[:] = [folder for folder in sys.path if folder not in cls.folders]
        if cls.folder:
            cls.folder.close()
        cls.digest, cls.unpacked, cls.folder, cls.modules, cls.folders = "", None, None, (), ()


atexit.register(_Cache.clear)


def _write(bundle: Bundle) -> Unpacked:
    _Cache.folder = ScratchFolder("campaign")
    root = _Cache.folder.path
    for path, data in bundle.files.items():
        place = root + path
        os.makedirs(os.path.dirname(place), exist_ok=True)
        with open(place, "wb") as file:
            file.write(_moved(data, bundle.files, root) if path.endswith(WITH_PATHS) else data)
    for name in bundle.modules:
        sys.modules.pop(name, None)
    _Cache.modules = bundle.modules
    _Cache.folders = tuple([root + folder for folder in bundle.folders])
    sys.path[:0] = _Cache.folders
    path = bundle.bundled_path(bundle.scenario)
    return Unpacked(root, root + path if path else bundle.scenario, bundle)


def _moved(data: bytes, files: Mapping[str, bytes], root: str) -> bytes:
    """Return a file's content, in which absolute paths of other bundled files are replaced by their unpacked paths."""
    for path in files:
        for quote in (b'"', b"'"):
            data = data.replace(quote + path.encode() + quote, quote + (root + path).encode() + quote)
    return data


def _build(name: str, changes: dict[str, Any]) -> None:
    """Build all parts of a run except the plan."""
    scenario = load_scenario(name, changes)
    vehicle, control = load_vehicle(scenario.vehicle)
    world = load_world(scenario.world)
    build_simulation(scenario, vehicle, world)
    build_pilot(scenario, vehicle, control, world)
    make_planner(scenario)
    make_request(scenario, vehicle, world)


class _Watch:
    """The interpreter's audit hook, which cannot be removed. It records opened files while `paths` is a set."""

    paths: set[str] | None = None
    is_set = False

    @classmethod
    def record_open(cls, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" and cls.paths is not None and isinstance(arguments[0], str):
            cls.paths.add(os.path.abspath(arguments[0]))


@contextmanager
def _opened_files() -> Iterator[set[str]]:
    """Provide the absolute paths of all files that are opened inside; cached files are read again there."""
    if not _Watch.is_set:
        sys.addaudithook(_Watch.record_open)
        _Watch.is_set = True
    before = os.environ.get("XDG_CACHE_HOME")
    with ScratchFolder("parsed") as scratch:
        folder = os.environ["XDG_CACHE_HOME"] = scratch.path
        paths: set[str] = set()
        _Watch.paths = paths
        try:
            yield paths
        finally:
            _Watch.paths = None
            if before is None:
                del os.environ["XDG_CACHE_HOME"]
            else:
                os.environ["XDG_CACHE_HOME"] = before
            paths -= {path for path in paths if path.startswith(folder)}


def _own_modules() -> dict[str, str]:
    """Return the modules in the folders of the classes that scenarios named, with files: those import others."""
    roots = {name.partition(".")[0] for name in loaded}
    files = {name: os.path.abspath(getattr(module, "__file__", None) or "") for name, module in sys.modules.items()}
    folders = {os.path.dirname(files[root]) for root in roots if root in files and not _is_installed(files[root])}
    return {
        name: path
        for name, path in files.items()
        if name != "__main__" and any(path.startswith(f"{place}/") for place in folders) and not _is_installed(path)
    }


def _is_installed(path: str) -> bool:
    """Return whether every machine with this project has the file, or it is the system's."""
    ours = [preset_folder(name) for name in PACKAGES]
    theirs = [sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    system = ["/proc", "/sys", "/dev", "/etc", "/usr"]
    return any(path.startswith(f"{folder}/") for folder in (*ours, *theirs, *system))
