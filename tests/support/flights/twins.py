"""The C extensions compiled from the present sources, for the tests that need them."""

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
    """Compile the C extensions into `folder`; skip where there is no compiler."""
    if reason := c_extensions.unavailable_reason():
        pytest.skip(f"no C here: {reason}")
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
