"""Every mistake in a TOML file is one line that names the file, the key and what was expected."""

import math
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import pytest

from hil.common.errors import ConfigError
from hil.common.schema import Range, load, parse


class Link(NamedTuple):
    baud: Annotated[int, Range(1200, 12_000_000)] = 115_200
    watchdog: Annotated[float, Range(0.02, 10.0, "s")] = 0.2
    wire: Literal["pty", "uart"] = "pty"
    angle: Annotated[float, Range(-7, 7, "rad")] = 0.0


class Thing(NamedTuple):
    name: str
    link: Link = Link()
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    links: tuple[Link, ...] = ()
    gains: dict[str, float] | None = None
    limit: float | None = None
    on: bool = True

    def validate(self) -> str | None:
        return "name is empty" if not self.name else None


def test_numbers_text_units_tables_and_arrays_are_read() -> None:
    table = {
        "name": "a",
        "link": {"watchdog": "500 ms", "angle": "90 deg"},
        "offset": [1, 2.5, 3],
        "links": [{"baud": 9600}, {}],
        "gains": {"p": 1},
        "limit": 4,
        "on": False,
    }
    parsed = parse(table, Thing, "x")
    assert parsed.link.watchdog == 0.5
    assert parsed.link.angle == pytest.approx(math.pi / 2)
    assert parsed.offset == (1.0, 2.5, 3.0)
    assert [link.baud for link in parsed.links] == [9600, 115_200]
    assert parsed.gains == {"p": 1.0}
    assert parsed.limit == 4.0
    assert parsed.on is False


@pytest.mark.parametrize(
    ("table", "expected_texts"),
    [
        ({}, ["'name' is missing"]),
        ({"name": "a", "lnik": {}}, ["no key 'lnik'", "did you mean 'link'"]),
        ({"name": "a", "link": {"buad": 1}}, ["link", "no key 'buad'", "'baud'"]),
        ({"name": "a", "link": {"baud": 9600.5}}, ["link: baud", "whole number"]),
        ({"name": "a", "link": {"baud": "fast"}}, ["link: baud", "number", "'fast'"]),
        ({"name": "a", "link": {"baud": "9.6 kBd"}}, ["link: baud", "number without a unit", "'9.6 kBd'"]),
        ({"name": "a", "link": {"baud": True}}, ["link: baud", "number", "true"]),
        ({"name": "a", "link": {"watchdog": 500}}, ["watchdog", "500 s is outside 0.02 to 10 s"]),
        ({"name": "a", "link": {"watchdog": "500"}}, ["watchdog", "no unit", "ms"]),
        ({"name": "a", "link": {"watchdog": "5 kg"}}, ["watchdog", "'kg'", "ms"]),
        ({"name": "a", "link": {"watchdog": "soon"}}, ["watchdog", "'soon'", "1 s"]),
        ({"name": "a", "link": {"watchdog": "1,5 s"}}, ["watchdog", "'1,5 s'", "1 s"]),
        ({"name": "a", "link": {"at": 1}}, ["link", "no key 'at'; there are: baud, watchdog, wire, angle"]),
        ({"name": "a", "link": {"angle_deg": 30}}, ["no key 'angle_deg'; write angle = \"30 deg\""]),
        ({"name": "a", "link": {"watchdog_ms": 5}}, ["no key 'watchdog_ms'; write watchdog = \"5 ms\""]),
        ({"nmae": "a"}, ["no key 'nmae'; did you mean 'name'?"]),
        ({"name": "a", "link": {"watchdog": math.nan}}, ["watchdog", "outside"]),
        ({"name": "a", "link": {"wire": "usrt"}}, ["wire", "pty, uart", "did you mean 'uart'"]),
        ({"name": "a", "link": {"wire": 3}}, ["wire", "pty, uart", "3"]),
        ({"name": "a", "link": 3}, ["link", "table"]),
        ({"name": 3}, ["name", "text"]),
        ({"name": "a", "on": 1}, ["on", "true or false"]),
        ({"name": "a", "offset": [1, 2]}, ["offset", "3 values, found 2"]),
        ({"name": "a", "offset": 1}, ["offset", "array"]),
        ({"name": "a", "offset": [1, 2, "x"]}, ["offset[2]", "number"]),
        ({"name": "a", "links": [{"baud": 1}]}, ["links[0]: baud", "outside"]),
        ({"name": "a", "gains": {"p": "x"}}, ["gains.p", "number"]),
        ({"name": ""}, ["name is empty"]),
    ],
)
def test_mistakes_are_reported_with_file_and_key(table: dict[str, Any], expected_texts: list[str]) -> None:
    with pytest.raises(ConfigError) as caught:
        parse(table, Thing, "thing.toml")
    message = str(caught.value)
    assert message.startswith("thing.toml")
    assert "\n" not in message
    assert all(word in message for word in expected_texts), message


def test_all_mistakes_are_listed_in_the_order_of_the_file() -> None:
    table: dict[str, Any] = {
        "links": [{"baud": 1}, {"baud": 9600}, {"wire": 3, "watchdg": 1}],
        "gains": {"p": "x", "d": 1, "i": "y"},
        "on": 1,
        "link": {"angle": 9, "speed": 1},
        "offset": ["x", 1, "y"],
    }
    with pytest.raises(ConfigError) as caught:
        parse(table, Thing, "thing.toml")
    lines = str(caught.value).splitlines()
    places = [
        "links[0]: baud", "links[2]: wire", "links[2]: no key 'watchdg'", "gains.p", "gains.i", "on", "link: angle",
        "link: no key 'speed'", "offset[0]", "offset[2]", "key 'name' is missing",
    ]  # fmt: skip
    assert [line.startswith(f"thing.toml: {place}") for line, place in zip(lines, places, strict=True)] == [True] * 11


def test_unreadable_files_are_reported(tmp_path: Path) -> None:
    broken = tmp_path / "broken.toml"
    broken.write_text("name = \n")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    for path, message in [
        (tmp_path / "no.toml", "no such file"),
        (tmp_path, "folder"),
        (broken, "TOML"),
        (binary, "TOML"),
    ]:
        with pytest.raises(ConfigError, match=message) as caught:
            load(str(path), Thing)
        assert str(path) in str(caught.value)
