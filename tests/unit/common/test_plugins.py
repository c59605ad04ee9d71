"""Classes of a user: an invalid class is not instantiated, and none is loaded where loading is refused."""

import re
import threading
from pathlib import Path
from typing import Any, Protocol

import pytest

from hil.common import plugins
from hil.common.errors import ConfigError
from hil.common.plugins import load_class, refusing


class Contract(Protocol):
    def begin(self) -> None: ...


class Good:
    def __init__(self, size: int = 0) -> None:
        self.size = size

    def begin(self) -> None: ...


def load(name: str, **arguments: Any) -> Any:
    return load_class({"class": name, **arguments}, Contract, "mine.toml: force", "forces")


@pytest.mark.parametrize(
    ("name", "message"),
    [("subprocess:Popen", "has no method 'begin'"), ("subprocess:check_call", "is no class"), ("os:path", "no class")],
)
def test_a_class_that_does_not_follow_the_contract_is_never_called(tmp_path: Path, name: str, message: str) -> None:
    trace = tmp_path / "trace"
    key = "args" if name == "subprocess:Popen" else "popenargs"
    with pytest.raises(ConfigError, match=rf"mine\.toml: force: {name} .*{message}"):
        load(name, **{key: ["touch", str(trace)]})
    assert not trace.exists()


def test_nothing_is_imported_while_loading_is_refused() -> None:
    name = f"{__name__}:Good"
    reported = re.escape(f"mine.toml: force: class {name!r} is not loaded: because")
    with refusing("because"):
        with refusing("of another reason"):
            pass
        with pytest.raises(ConfigError, match=reported):
            load(name)
        with pytest.raises(ConfigError, match="is not loaded: because"):
            load("no_such_module:Good")
        objects: list[Any] = []
        thread = threading.Thread(target=lambda: objects.append(load(name, size=3)))  # which reads a file of its own
        thread.start()
        thread.join()
        assert objects[0].size == 3
    assert isinstance(load(name), Good)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("import nowhere_at_all", "No module named 'nowhere_at_all'; correct its imports"),
        ("from os import nothing_there", "correct its imports"), ("def x(", "was never closed"),
    ],
)  # fmt: skip
def test_a_module_that_fails_to_load_is_reported_with_the_cause(
    text: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The error names the cause; such a module is not reported as missing."""
    (tmp_path / "unloadable.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ConfigError, match=re.escape(message)) as error:
        load("unloadable:Class")
    assert "PYTHONPATH" not in str(error.value)


def test_an_error_while_a_module_loads_is_attributed_to_that_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plugins, "loaded", set())  # without the names of other tests
    (tmp_path / "unfinished.py").write_text("import json\njson.loads('{')\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ValueError, match="Expecting") as caught:
        load("unfinished:Good")
    own = plugins.own_traceback(caught.value)
    assert own is not None
    assert (Path(own.tb_frame.f_code.co_filename).name, own.tb_lineno) == ("unfinished.py", 2)
