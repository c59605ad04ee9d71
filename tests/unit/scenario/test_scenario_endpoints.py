"""An invalid endpoint of a scenario is an error of the file, with its key, when the file is loaded."""

from pathlib import Path

import pytest

from hil.cli import main
from hil.common.errors import ConfigError
from hil.scenario.config import load_scenario

HEAD = 'vehicle = "paper_seven"\nworld = "pool"\n[master]\n'
MEMBER = 'node = "a"\nnorth = 0\neast = 0\n'
GOOD = "tcp/127.0.0.1:7447"
ENDPOINTS = [
    ('[slave]\nlisten = "{}"', "slave: listen"),
    ('[network]\nmode = "routed"\nrouter = "{}"', "network: router"),
    (f'[[member]]\n{MEMBER}listen = "{{}}"\nagent = "{GOOD}"', "member[0]: listen"),
    (f'[[member]]\n{MEMBER}listen = "{GOOD}"\nagent = "{{}}"', "member[0]: agent"),
]


@pytest.mark.parametrize(("tail", "key"), ENDPOINTS)
def test_an_invalid_endpoint_is_reported_by_file_and_key(
    tail: str, key: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.toml"
    for endpoint in (
        "udp/1.2.3.4:7447",
        "tcp/host:99999",
        "tcp/",
        "tcp/:7447",
        "::1",
        "7447",
        "tcp/a b:1",
        "x" * 999 + ":0",
    ):
        path.write_text(HEAD + tail.format(endpoint))
        with pytest.raises(ConfigError) as error:
            load_scenario(str(path))
        assert str(error.value).startswith(f"{path}: {key}: endpoint ")
        assert "is not of the form tcp/HOST:PORT" in str(error.value)
        assert len(str(error.value)) < len(str(path)) + 300
    for command in ("slave FILE", "sim FILE --fast", "fleet agent FILE --member a", "top --scenario FILE"):
        assert main([str(path) if word == "FILE" else word for word in command.split()]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert f"{path}: {key}: endpoint" in line
    for endpoint in ("192.168.3.116", "pi.local:7449", "tcp/[::1]:7447"):
        path.write_text(HEAD + tail.format(endpoint))
        load_scenario(str(path))
