"""Every number in a file that a person writes has a range, and a value outside it is refused by its key."""

import importlib
import math
import pkgutil
import types
from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple, Union, get_args, get_origin

import pytest

from hil.common.errors import ConfigError
from hil.common.schema import Range, parse

PACKAGES = ("hil", "sim", "boards", "firmware_stub")
EXCLUDED = {"hil.__main__", "hil.slave.imaging.process", "hil.install.changes"}  # processes; a file it makes
WITHOUT_LIMIT = {("AxisGains", "slew"), ("Surface", "slew")}  # inf there: as fast as it comes
HUGEST = 1e15  # a number whose fourth power is finite, so that a simulation can compute with it
HOSTILE = (math.inf, -math.inf, math.nan, 1e300, -1e300, 10**400, -(10**400))


def records() -> Iterator[type[Any]]:
    """Yield the records with at least one range, which are read from files or messages."""
    for package in PACKAGES:
        for module in pkgutil.walk_packages(importlib.import_module(package).__path__, f"{package}."):
            if module.name in EXCLUDED or ".native._" in module.name or ".images" in module.name:
                continue
            for record in vars(importlib.import_module(module.name)).values():
                is_record = isinstance(record, type) and issubclass(record, tuple) and hasattr(record, "_fields")
                if is_record and record.__module__ == module.name and any(map(has_range, annotations(record).values())):
                    yield record


def annotations(record: type[Any]) -> dict[str, Any]:
    return record.__annotations__


def has_range(annotation: Any) -> bool:
    return any(limit is not None for limit in numbers(annotation))


def numbers(annotation: Any) -> Iterator[Range | None]:
    """Yield the range of each number in an annotation, None for one without."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        yield next((argument for argument in arguments[1:] if isinstance(argument, Range)), None)
    elif annotation in (int, float):
        yield None
    elif origin in (tuple, dict, Union, types.UnionType):
        for argument in arguments:
            yield from numbers(argument)


@pytest.fixture(scope="module")
def keys() -> list[tuple[type[Any], str]]:
    """Return the keys with numbers. They are collected here: an import of all modules slows every collection."""
    return [
        (record, key)
        for record in sorted(set(records()), key=lambda record: (record.__module__, record.__name__))
        for key, annotation in annotations(record).items()
        if any(True for _ in numbers(annotation)) and (record.__name__, key) not in WITHOUT_LIMIT
    ]


def test_the_records_with_ranges_are_found(keys: list[tuple[type[Any], str]]) -> None:
    names = {record.__name__ for record, _ in keys}
    assert names >= {"Vehicle", "Thruster", "Fin", "World", "Scenario", "Master", "Slave", "Start", "Member", "Network"}
    assert len(keys) > 250


def test_every_number_of_a_file_has_a_range(keys: list[tuple[type[Any], str]]) -> None:
    unlimited = {
        f"{record.__module__}.{record.__name__}.{key}"
        for record, key in keys
        for limit in numbers(annotations(record)[key])
        if limit is None or not (-HUGEST <= limit.low <= limit.high <= HUGEST or key == "seed")
    }
    assert not unlimited, f"give it an Annotated[float, Range(low, high)]: {', '.join(sorted(unlimited))}"


def value_of_type(annotation: Any, value: Any) -> Any:
    """Return a value of that kind whose every number is `value`."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is tuple:
        return (
            [value_of_type(arguments[0], value)] * 3
            if arguments[-1] is Ellipsis
            else [value_of_type(argument, value) for argument in arguments]
        )
    if origin is dict:
        return {"x": value_of_type(arguments[1], value)}
    if origin in (Union, types.UnionType):
        return value_of_type(next(argument for argument in arguments if argument is not type(None)), value)
    return value


def test_values_out_of_range_are_refused_by_their_key(keys: list[tuple[type[Any], str]]) -> None:
    for record, key in keys:
        annotation = annotations(record)[key]
        alone: Any = NamedTuple("alone", [(key, annotation)])  # type: ignore[misc]
        for value in HOSTILE:
            with pytest.raises(ConfigError, match=rf"^file\.toml: {key}(\[0\]|\.x)*: ") as error:
                parse({key: value_of_type(annotation, value)}, alone, "file.toml")
            assert all(len(line) < 150 and line.startswith("file.toml: ") for line in str(error.value).splitlines())
