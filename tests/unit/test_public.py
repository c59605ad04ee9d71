"""The public names of `hil` and `sim`: each is there, and pages and examples import nothing else."""

import ast
import importlib
import re
from pathlib import Path

import pytest

import hil
import sim
from tests.support.documents import blocks

ROOT = Path(hil.__file__).parents[1]
PAGE = ROOT / "docs/reference/python_api.md"
# Modules that pages import although their names are no part of the interface, with the reason.
SPECIAL = {"sim.environment.optics": "docs/reference/sensors.md shows its formulas"}


@pytest.mark.parametrize("package", [hil, sim])
def test_each_public_name_is_there_for_programs_and_for_type_checkers(package: object) -> None:
    name, file, public = package.__name__, package.__file__, package.PUBLIC  # type: ignore[attr-defined]
    for module, names in public.items():
        for each in names:
            assert getattr(package, each) is getattr(importlib.import_module(module), each)
            assert each in dir(package)
            assert re.search(rf"^::: {re.escape(module)}(\.{each})?$", PAGE.read_text(), flags=re.MULTILINE)
    guarded = [node for node in ast.walk(ast.parse(Path(file).read_text())) if isinstance(node, ast.ImportFrom)]
    typed = {(node.module, alias.name) for node in guarded for alias in node.names if alias.asname == alias.name}
    assert typed - {("hil.common", "__version__")} == {(m, each) for m, names in public.items() for each in names}
    with pytest.raises(AttributeError, match=f"module '{name}' has no attribute 'nothing'"):
        getattr(package, "nothing")  # noqa: B009 - mypy knows that there is none


def test_pages_and_examples_import_public_names_only() -> None:
    texts = [(block.page, block.text) for block in blocks("python")]
    texts += [(str(path), path.read_text()) for path in (ROOT / "examples").rglob("*.py")]
    imported = set()
    for page, text in texts:
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in ("hil", "sim"):
                imported.add((page, node.module))
    assert {(page, module) for page, module in imported if module not in ("hil", "sim", *SPECIAL)} == set()
    assert len(imported) > 3
