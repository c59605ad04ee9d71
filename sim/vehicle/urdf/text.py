"""Read the XML of URDF and SDF files: elements and numbers, and the conversion of axes from FLU to FRD."""

import os
import re
from collections.abc import Iterable
from math import isnan, nan
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

from hil.common.errors import ConfigError
from hil.common.tables import read_bytes
from sim.matrices import Matrix
from sim.vehicle.urdf.ros_packages import find_file

Element = ElementTree.Element
_FRD = (1.0, -1.0, -1.0)
_LARGEST = 1e60
MAX_DEPTH = 64  # of nested elements: those of robots have some ten


def read_xml(path: str, text: bytes | None = None, root: str = "robot") -> Element:
    """Return the `<robot>` (or the element `root`) of the file, or of `text` in its place. Raises ConfigError.

    An XML entity may stand for another file or for gigabytes, so entities are refused. Elements may be nested at most
    `MAX_DEPTH` deep.
    """
    data = read_bytes(path) if text is None else text
    if root == "sdf":
        data = _tolerate_as_gazebo(data)
    try:
        check_xml(data)
        robot = ElementTree.fromstring(data)
    except (expat.ExpatError, ElementTree.ParseError) as error:
        is_template = any(mark in data for mark in (b"<%", b"{%", b"{{"))
        hint = "; a template of ERB or Jinja is to be expanded first" if is_template else ""
        raise ConfigError(f"{path}: not valid XML: {error}{hint}") from None
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    for element in robot.iter():
        if "xacro" in element.tag or any("${" in text or "$(" in text for text in element.attrib.values()):
            raise ConfigError(f"{path}: is xacro, to be expanded first: name it .xacro, or declare its namespace")
    if robot.tag != root:
        kind = "a URDF" if root == "robot" else "an SDF file"
        raise ConfigError(f"{path}: {kind} begins with <{root}>, this one with <{robot.tag}>")
    return robot


def _tolerate_as_gazebo(data: bytes) -> bytes:
    """Return an SDF without the faults that Gazebo's parser tolerates and other parsers do not.

    Prefixes of Gazebo's own tags are declared, because many files do not declare them. Comments are removed, because
    they may contain `--`.
    """
    data = re.sub(rb"<!--.*?-->", lambda comment: b"\n" * comment[0].count(b"\n"), data, flags=re.DOTALL)
    for prefix in (b"gz", b"ignition", b"experimental"):
        if prefix + b":" in data and b"xmlns:" + prefix not in data:
            data = data.replace(b"<sdf", b'<sdf xmlns:%b="%b"' % (prefix, prefix), 1)
    return data


def check_xml(data: bytes) -> None:
    """Raise ConfigError for XML that declares entities or is nested too deep, expat.ExpatError for invalid XML."""
    depth = 0

    def enter(name: str, _: Any) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise ConfigError(f"elements in each other, more than {MAX_DEPTH} deep, at <{name[:40]}>")

    def leave(_: str) -> None:
        nonlocal depth
        depth -= 1

    guard = expat.ParserCreate()
    guard.EntityDeclHandler = _refuse_entity
    guard.StartElementHandler, guard.EndElementHandler = enter, leave
    guard.Parse(data, True)


def root_of(data: bytes) -> str:
    """Return the name of the root element of a text, "" if it has none."""
    match = re.search(rb"<([A-Za-z_][\w:.-]*)", re.sub(rb"<!--.*?-->", b"", data, flags=re.DOTALL))
    return match[1].decode() if match else ""


def _refuse_entity(name: str, *_: Any) -> None:
    raise ConfigError(f"declares the XML entity {name!r}: write what it stands for")


def to_frd(vector: Iterable[float]) -> list[float]:
    """Return a point or direction, given in FLU, in FRD."""
    return [sign * x + 0.0 for sign, x in zip(_FRD, vector, strict=True)]


def to_frd_matrix(matrix: Matrix) -> list[float]:
    """Return a 3x3 or 6x6 matrix, given in FLU, in FRD: its diagonal if it is diagonal, else row after row."""
    signs = _FRD * (len(matrix) // 3)
    turned = [[a * b * x + 0.0 for b, x in zip(signs, row, strict=True)] for a, row in zip(signs, matrix, strict=True)]
    if any(x for i, row in enumerate(turned) for j, x in enumerate(row) if i != j):
        return [x for row in turned for x in row]
    return [row[i] for i, row in enumerate(turned)]


def attribute(element: Element, child: str, name: str, default: str = "") -> str:
    """Return the attribute `name` of the child element `child`, or `default`."""
    inner = element.find(child)
    return default if inner is None else inner.get(name, default)


def child_text(element: Element, *names: str) -> str | None:
    """Return the text of the first of these child elements that exists, or None."""
    return next((text.strip() for name in names if (text := element.findtext(name)) is not None), None)


def numbers_of(text: str, path: str, *counts: int) -> list[float]:
    """Return the numbers in `text`. Raises ConfigError if their count is none of `counts`."""
    numbers = [number_of(word, path) for word in text.split()]
    if len(numbers) not in counts:
        raise ConfigError(f"{path}: expected {' or '.join(map(str, counts))} numbers, found {text.strip()[:60]!r}")
    return numbers


def number_of(text: str, path: str) -> float:
    """Return `text` as a number between 1e-60 and 1e60 of either sign, or 0, so that no power of it fails.

    Smaller and larger numbers, as for joints without limits, become 0 or the bound. Raises ConfigError.
    """
    try:
        number = float(text)
    except ValueError:
        number = nan
    if isnan(number):
        raise ConfigError(f"{path}: expected a number, found {text.strip()[:60]!r}")
    return max(-_LARGEST, min(_LARGEST, number)) if abs(number) > 1.0 / _LARGEST else 0.0


def plain(name: str) -> str:
    """Return a name without control characters, which a vehicle file cannot contain."""
    return "".join(letter for letter in name if letter.isprintable())


def unscoped(name: str) -> str:
    """Return the last part of a name such as `robot/link` or `model::link`, without control characters."""
    return plain(name.rpartition("/")[2].rpartition("::")[2])


def listed(vector: Iterable[float]) -> str:
    """Return numbers as a list of a vehicle file, without rounding errors."""
    return "[" + ", ".join(f"{round(x, 9) + 0.0:.6g}" for x in vector) + "]"


def find_mesh(name: str, path: str) -> str:
    """Return the path of a mesh that the file at `path` names.

    package:// and model:// are searched as sim/vehicle/urdf/ros_packages.py does. A name that cannot be found is
    returned unchanged.
    """
    if name.startswith(("package://", "model://")):
        return find_file(name, path) or name
    plain_name = name.removeprefix("file://")
    return plain_name if os.path.isabs(plain_name) else os.path.join(os.path.dirname(os.path.abspath(path)), plain_name)
