"""Lazy imports: a stand-in imports its module on first use."""

import sys

import pytest

from tests.support.lazy import import_lazily


def test_a_module_is_imported_on_first_use(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "colorsys", raising=False)
    colorsys = import_lazily("colorsys")
    for name in ("__test__", "__wrapped__", "_mock_name"):
        assert not hasattr(colorsys, name)
    assert "colorsys" not in sys.modules
    assert colorsys.rgb_to_hsv(1.0, 0.0, 0.0) == (0.0, 1.0, 1.0)
    assert "colorsys" in sys.modules


def test_an_attribute_of_a_lazy_module_can_be_a_stand_in() -> None:
    assert import_lazily("os", "path").sep == "/"
