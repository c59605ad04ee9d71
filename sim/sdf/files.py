"""Find and read files that an SDF file names: models by `model://`, and files beside it. It never uses the network.

The folder of a model is searched as `sim.vehicle.urdf.ros_packages` says. A model of Gazebo Fuel is also searched in
the folder of `gz fuel download`. Files outside of those folders and of `_LEVELS_UP` folders above the file are not
opened.
"""

import os
import re
from collections.abc import Iterator
from copy import deepcopy
from functools import cache, partial
from urllib.parse import unquote

from hil.common.errors import ConfigError
from hil.common.tables import read_bytes
from sim.vehicle.urdf.ros_packages import find_packages, resource_folders
from sim.vehicle.urdf.text import Element, read_xml

# Models of Gazebo that every installation has, used if they are not found.
_BUILT_IN = {
    "sun": b'<sdf><light name="sun" type="directional"/></sdf>',
    "ground_plane": b'<sdf version="1.9"><model name="ground_plane"><static>1</static><link name="link"><collision '
    b'name="collision"><geometry><plane><size>100 100</size></plane></geometry></collision></link></model></sdf>',
}
MAX_FILES = 500  # included files, in total
_LEVELS_UP = 2
_FUEL = re.compile(
    r"https?://(?:app\.|fuel\.)[\w.]+/(?:1\.0/)?([^/]+)/(?:fuel/)?models/([^/]+)(?:/(?:tip|\d+))?(?:/files)?(/.*)?$"
)


class SdfFiles:
    """Finds and reads the files that the SDF at `path` names."""

    def __init__(self, path: str) -> None:
        self.path = path
        top = os.path.dirname(os.path.realpath(path))
        for _ in range(_LEVELS_UP):
            top = os.path.dirname(top)
        self._shared = resource_folders()
        self._roots = [os.path.realpath(folder) for folder in (top, *self._shared)]
        self._find = cache(self._search)
        self._read = cache(partial(read_xml, root="sdf"))
        self._count = 0
        self.missing: list[str] = []  # what was not found, for reports

    def find(self, uri: str, folder: str, is_model: bool = False) -> str | None:
        """Return the path of a file, or of a model's folder, that a file in `folder` names; None if it is not found."""
        return self._find(uri.strip(), folder, is_model)

    def read_model(self, uri: str, folder: str) -> tuple[Element, str] | None:
        """Return the root element of an included model's SDF file, and its folder; None if it is not found.

        Raises ConfigError if it is no SDF, or if too many are included.
        """
        self._count += 1
        if self._count > MAX_FILES:
            raise ConfigError(f"{self.path}: includes more than {MAX_FILES} models")
        found = self.find(uri, folder, is_model=True)
        if found is None:
            name = unquote(uri.rstrip("/").rpartition("/")[2]).lower().replace(" ", "_")
            built_in = _BUILT_IN.get(name)
            return (read_xml(name, built_in, "sdf"), folder) if built_in else None
        file = _model_file(found) if os.path.isdir(found) else found
        return deepcopy(self._read(file)), os.path.dirname(file)

    def places(self) -> str:
        """Return the folders that are searched, for messages."""
        around = f"the folders around {os.path.dirname(os.path.abspath(self.path))}"
        return ", ".join([*self._shared, around])

    def _search(self, uri: str, folder: str, is_model: bool) -> str | None:
        for candidate in self._candidates(uri, folder):
            real = os.path.realpath(candidate)
            if os.path.isdir(real) if is_model else os.path.isfile(real):
                if not is_model or _model_file(real):
                    return candidate
            elif is_model and os.path.isfile(real) and real.endswith((".sdf", ".world")):
                return candidate
        return None

    def _candidates(self, uri: str, folder: str) -> Iterator[str]:
        """Yield the paths that `uri` may mean, the likeliest first."""
        fuel = _FUEL.match(uri)
        scheme, separator, location = uri.partition("://")
        if fuel:
            yield from self._of_fuel(*fuel.groups(default=""))
        elif separator and scheme in ("model", "package"):
            yield from self._of_package(unquote(location))
        elif separator and scheme != "file":
            return  # a network address
        else:
            yield from self._allowed(os.path.join(folder, unquote(location if separator else uri)))
            for top in self._shared:
                yield from self._allowed(os.path.join(top, unquote(location if separator else uri)))
            if (location if separator else uri)[:1] not in ("", ".", os.sep):
                for package_file in self._of_package(unquote(location if separator else uri)):
                    yield from self._allowed(package_file)

    def _of_package(self, location: str) -> Iterator[str]:
        name, _, inside = location.partition("/")
        for package in find_packages(name, self.path):
            yield from _inside(package, inside)

    def _of_fuel(self, owner: str, name: str, inside: str) -> Iterator[str]:
        name = unquote(name)
        for base in ("~/.gz/fuel", "~/.ignition/fuel"):
            models = os.path.join(os.path.expanduser(base), "fuel.gazebosim.org", owner.lower(), "models", name.lower())
            versions = sorted(os.listdir(models), key=_number, reverse=True) if os.path.isdir(models) else []
            for version in versions:
                yield from _inside(os.path.join(models, version), inside.lstrip("/"))
        for folder in dict.fromkeys((name, name.lower().replace(" ", "_"))):
            yield from self._of_package(folder + inside)

    def _allowed(self, path: str) -> Iterator[str]:
        real = os.path.realpath(path)
        if any(os.path.commonpath([root, real]) == root for root in self._roots):
            yield path


def _inside(folder: str, inside: str) -> Iterator[str]:
    """Yield the path of `inside` in `folder`, unless it is outside of the folder."""
    path = os.path.join(folder, inside)
    top = os.path.realpath(folder)
    if os.path.commonpath([top, os.path.realpath(path)]) == top:
        yield path


def _number(text: str) -> int:
    return int(text) if text.isdecimal() else -1


def _model_file(folder: str) -> str:
    """Return the SDF file of a model's folder: that of the newest version in its model.config, or model.sdf, or ""."""
    config = os.path.join(folder, "model.config")
    if os.path.isfile(config):
        text = read_bytes(config).decode("utf-8", "replace")
        named = re.findall(r"<sdf(?:\s+version=[\"']([\d.]+)[\"'])?\s*>\s*([^<\s]+)\s*</sdf>", text)
        for _, name in sorted(named, key=lambda each: [_number(part) for part in each[0].split(".")], reverse=True):
            for path in _inside(folder, name):
                if os.path.isfile(path):
                    return path
    file = os.path.join(folder, "model.sdf")
    return file if os.path.isfile(file) else ""
