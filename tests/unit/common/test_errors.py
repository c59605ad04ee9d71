"""Errors name the remedy that fits this installation."""

import sys

import pytest

from hil.common.errors import MissingExtraError


@pytest.mark.parametrize(
    ("prefix", "command"),
    [
        ("/usr", "pip install"),
        ("/home/pi/.local/share/pipx/venvs/uuv-hil", "pipx install --force"),
        ("C:\\Users\\me\\AppData\\Roaming\\uv\\tools\\uuv-hil", "uv tool install --force"),
    ],
)
def test_a_missing_extra_is_installed_as_the_program_was(
    monkeypatch: pytest.MonkeyPatch, prefix: str, command: str
) -> None:
    monkeypatch.setattr(sys, "prefix", prefix)
    assert (
        str(MissingExtraError("a map needs pip install 'uuv-hil[chart]'")) == f"a map needs {command} 'uuv-hil[chart]'"
    )
