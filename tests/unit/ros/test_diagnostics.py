"""The table of diagnostics: typed both ways and complete, and every used name is in it."""

import ast
import re
from pathlib import Path
from typing import Any

import pytest

from hil.autopilots.contract import AutopilotCounters
from hil.links.address import wire_kind
from hil.links.contract import Counters
from hil.ros import encoders as ros
from hil.ros.diagnostics import Diagnostics, or_nan, to_text
from sim.run_events import RunEvent
from tests.support.diagnostics import reported

ROOT = Path(__file__).parents[3]
SAMPLES: dict[str, Any] = {
    "number": 2.0, "integer": 7, "counter": 3, "flag": True, "text": "a b; c", "integers": (1500, 1600),
    'texts, separated by " "': ("one", "two"), 'texts, separated by "; "': ("emulated: a test", "two"),
    "sensor=number": {"camera": 3.0, "forward_sonar": 9.0},
    "fault=number": {"dropped": 2.0, "stalls": 0.0},
    "events": (RunEvent("collision", 5, 7, (1.0, 2.5, -3.125), "the pile"), RunEvent("capsize", 9, 0, (0.0, 0.0, 4.0))),
}  # fmt: skip


def test_every_diagnostic_survives_a_round_trip_in_its_type() -> None:
    output = reported(**{name: SAMPLES[figure.kind] for name, figure in Diagnostics.FIGURES.items()})
    statuses = ros.decode_diagnostics(ros.encode_diagnostics(0, [("slave", 0, "running", output.raw)]))
    decoded = Diagnostics(statuses[0][3] if statuses else {})
    for name, figure in Diagnostics.FIGURES.items():
        assert getattr(decoded, name) == decoded[name] == SAMPLES[figure.kind], name
        assert type(decoded[name]) is type(SAMPLES[figure.kind]), name
    assert list(decoded.as_dict()) == list(Diagnostics.FIGURES)


def test_a_name_that_is_not_in_the_table_is_an_error() -> None:
    output = Diagnostics({"link_wires": "pty"})
    with pytest.raises(KeyError, match="link_wires"):
        output["link_wires"]
    with pytest.raises(KeyError, match="link_wires"):
        output["link_wires"] = "pty"
    with pytest.raises(AttributeError):
        print(output.link_wires)  # type: ignore[attr-defined]  # the type checker reports it too
    with pytest.raises(AttributeError):
        output.link_wires = "pty"  # type: ignore[attr-defined]  # and here
    assert output.as_dict() == {}


def test_missing_and_malformed_diagnostics_are_none() -> None:
    assert Diagnostics().cpu_s is None
    assert not Diagnostics()
    wrong = {"cpu_s": "nan", "cores": "many", "armed": "yes", "pwm_us": "1500 x", "imaging_took_ms": "camera=inf"}
    output = Diagnostics(wrong)
    assert set(output.as_dict().values()) == {None}
    assert str(or_nan(output.cpu_s)) == "nan"
    assert (to_text(output.cpu_s), to_text(2.5, ".2f"), to_text("x")) == ("-", "2.50", "x")


def test_each_link_counter_has_its_diagnostic() -> None:
    for name in Counters.__slots__:
        assert Diagnostics.FIGURES[f"link_{name}"].is_counter


def test_each_autopilot_counter_has_its_diagnostic() -> None:
    names = {"outputs": "packets"}  # and `states`, which the slave counts as its steps
    for name in set(AutopilotCounters.__slots__) - {"states"}:
        assert Diagnostics.FIGURES[f"autopilot_{names.get(name, name)}"].is_counter


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("/dev/ttyUSB0", "uart"), ("/dev/pts/3", "pty"), ("rs485:/dev/ttyUSB0", "rs485"), ("tcp://h:1", "tcp"),
        ("udp://h:1", "udp"), ("can:socketcan:can0", "can"), ("pty:/dev/pts/3", "pty"),
    ],
)  # fmt: skip
def test_the_kind_of_a_wire_follows_from_its_name(name: str, kind: str) -> None:
    assert wire_kind(name) == kind


def test_a_symbolic_link_to_a_pty_is_a_pty(tmp_path: Path) -> None:
    (tmp_path / "stm32").symlink_to("/dev/pts/0")
    assert wire_kind(str(tmp_path / "stm32")) == "pty"


def test_diagnostics_are_read_through_the_table_only() -> None:
    """The table alone parses the texts: in other places a name could be misspelt."""
    raw = {
        path.relative_to(ROOT).as_posix()
        for folder in ("hil", "sim", "boards", "tools")
        for path in (ROOT / folder).rglob("*.py")
        if ".raw" in path.read_text()  # to parse all modules takes seconds
        for node in ast.walk(ast.parse(path.read_text()))
        if (isinstance(node, ast.Subscript) and _ends_in_raw(node.value))
        or (isinstance(node, ast.Attribute) and node.attr == "get" and _ends_in_raw(node.value))
    }
    assert raw == {"hil/ros/diagnostics.py"}


def _ends_in_raw(node: ast.expr) -> bool:
    return isinstance(node, ast.Attribute) and node.attr == "raw"


def test_names_in_docs_are_in_the_table() -> None:
    """Documents name a figure as `vehicle.diagnostics.NAME`."""
    for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        for name in re.findall(r"diagnostics\.([a-z]\w+)", path.read_text()):
            assert name in {*Diagnostics.FIGURES, "py", "md"}, f"{path.name}: {name}"
