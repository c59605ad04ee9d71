"""The C extensions compiled from the present sources, for the tests that need them."""

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
from hypothesis import HealthCheck

import c_extensions
from tests.support.examples import examples

# For tests that compare the twins; `taken_from` holds for all examples of one.
EACH = examples(200, HealthCheck.function_scoped_fixture, HealthCheck.differing_executors)


def compiled(folder: Path) -> None:
    """Compile the C extensions into `folder`, or copy those of the clone if they are newer than all sources.

    Skips where there is no compiler.
    """
    if reason := c_extensions.unavailable_reason():
        pytest.skip(f"no C here: {reason}")
    root, found = Path(c_extensions.ROOT), list(c_extensions.SOURCES)
    rooms = ("sim/native", "hil/slave/native", "firmware_stub/src", c_extensions.HEADERS)
    sources = [Path(c_extensions.__file__), *(file for room in rooms for file in (root / room).glob("*.[ch]"))]
    changed = max(file.stat().st_mtime for file in sources)
    if all((root / name).exists() and (root / name).stat().st_mtime > changed for name in found):
        for name in found:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(root / name, folder / name)
    else:
        assert c_extensions.build(str(folder)) is None


@contextmanager
def taken_from(folder: Path) -> Iterator[None]:
    """Let `import sim.native._native` and the others find the extensions in `folder`, never older ones."""
    with pytest.MonkeyPatch.context() as patch:
        for binary in c_extensions.SOURCES:
            name = c_extensions.module(binary)
            spec = spec_from_file_location(
                name, folder / binary, loader=ExtensionFileLoader(name, str(folder / binary))
            )
            assert spec is not None
            assert spec.loader is not None
            module = module_from_spec(spec)
            spec.loader.exec_module(module)
            patch.setitem(sys.modules, name, module)
            package, _, leaf = name.rpartition(".")
            patch.setattr(import_module(package), leaf, module, raising=False)
        patch.delenv("UUV_HIL_NATIVE", raising=False)
        yield
