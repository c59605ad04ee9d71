"""Detection of modules that were loaded from bytecode, which decides how fast a slave starts."""

import sys
from types import ModuleType

import pytest

from hil.slave.health.reporter import bytecode_compiled


def test_a_package_that_is_not_loaded_has_no_bytecode() -> None:
    assert not bytecode_compiled("no_such_package")


def test_modules_in_c_need_no_bytecode(monkeypatch: pytest.MonkeyPatch) -> None:
    package, twin, late = ModuleType("made_up"), ModuleType("made_up._twin"), ModuleType("made_up.late")
    monkeypatch.setattr(package, "__cached__", __file__, raising=False)
    twin.__file__, late.__file__ = "_twin.abi3.so", "late.py"
    monkeypatch.setitem(sys.modules, package.__name__, package)
    monkeypatch.setitem(sys.modules, twin.__name__, twin)
    assert bytecode_compiled("made_up")
    monkeypatch.setitem(sys.modules, late.__name__, late)
    assert not bytecode_compiled("made_up")
