"""An invalid section of a scenario is reported with file, key and remedy."""

from pathlib import Path
from typing import Any

import pytest

from hil.common.errors import ConfigError
from hil.common.schema import find_preset
from hil.scenario.config import load_scenario

FLOWN = 'vehicle = "paper_six"\nworld = "pool"\nmaster = {}\n'


@pytest.mark.parametrize("value", ['"/dev/ttyUSB0"', "3", "true", "[1]", '[["port", "pty:"]]'])
@pytest.mark.parametrize("name", ["link", "link.options"])
def test_a_value_in_place_of_a_section_is_refused(tmp_path: Path, name: str, value: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f"{FLOWN}{name} = {value}\n")
    with pytest.raises(ConfigError) as caught:
        load_scenario(str(path))
    assert str(caught.value).startswith(
        f"{path}: {name.replace('.', ': ')}: expected a table: write its keys under [{name}], found "
    )


@pytest.mark.parametrize(("section", "options"), [("", {}), ("[link]", {}), ("[link.options]\na = 1", {"a": 1})])
def test_a_link_section_may_be_empty_or_have_options(tmp_path: Path, section: str, options: dict[str, Any]) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f"{FLOWN}{section}\n")
    assert load_scenario(str(path)).link.options == options


def test_a_path_on_the_command_line_is_relative_to_the_current_folder(tmp_path: Path, monkeypatch: Any) -> None:
    """The rule holds also for an installed scenario, whose own paths are relative to its file."""
    (tmp_path / "mine.toml").write_text(Path(find_preset("sim/worlds", "paper_field")).read_text())
    monkeypatch.chdir(tmp_path)
    assert load_scenario("paper_field", {"world": "mine.toml"}).world == str(tmp_path / "mine.toml")
    with pytest.raises(ConfigError, match=r"yours\.toml: no such file"):
        load_scenario("paper_field", {"world": "yours.toml"})
