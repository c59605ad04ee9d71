"""Extensions that were compiled from other sources than the present ones."""

from pathlib import Path

import pytest

import c_extensions
import sim.native
from hil.common.errors import ConfigError
from sim.native import has_native


@pytest.mark.usefixtures("native")
@pytest.mark.parametrize("name", [c_extensions.module(path) for path in c_extensions.SOURCES])
def test_a_binary_of_other_sources_is_refused_with_the_remedy(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A pull may change C without a new installation: neither slower Python nor a missing attribute names the cause."""
    monkeypatch.setattr(sim.native, "_source_bytes", lambda package: " 1" if package == name.rpartition(".")[0] else "")
    with pytest.raises(ConfigError, match=r"_\w+\.abi3\.so was compiled from other sources .* python c_extensions.py"):
        has_native(name)


def test_a_change_of_the_sources_changes_their_size(tmp_path: Path) -> None:
    """The size is that of the C sources, without other files in the folder."""
    (tmp_path / "a.c").write_text("int a;\n")
    (tmp_path / "a.h").write_text("extern int a;\n")
    (tmp_path / "a.abi3.so").write_text("binary")
    assert c_extensions.source_bytes(str(tmp_path)) == len("int a;\nextern int a;\n")
