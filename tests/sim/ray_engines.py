"""The rays in C as their source stands now, for the tests that need them."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

import sim.native
from sim.native import build


def compiled(folder: Path) -> None:
    """Compile into `folder`; skips where there is no compiler."""
    if reason := build.obstacle():
        pytest.skip(f"no rays in C: {reason}")
    assert build.build(str(folder)) is None


@contextmanager
def taken_from(folder: Path) -> Iterator[None]:
    """`import sim.native._native` and `_rays` find what is in `folder`, never what is left from an older source."""
    with pytest.MonkeyPatch.context() as patch:
        for binary in build.SOURCES:
            name = f"sim.native.{binary.partition('.')[0]}"
            spec = spec_from_file_location(
                name, folder / binary, loader=ExtensionFileLoader(name, str(folder / binary))
            )
            assert spec is not None
            assert spec.loader is not None
            module = module_from_spec(spec)
            spec.loader.exec_module(module)
            patch.setitem(sys.modules, name, module)
            patch.setattr(sim.native, name.rpartition(".")[2], module, raising=False)
        patch.delenv("UUV_HIL_NATIVE", raising=False)
        yield
