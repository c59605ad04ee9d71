"""Compiler flags: the C code compiles only where doubles are computed as doubles."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

import c_extensions

ROOT = Path(__file__).parents[4]
TWINS = ["sim/native/kernel.h", "sim/native/rays_seabed.h"]


def compiles(compiler: str, header: str, folder: Path, *flags: str, method: str = "") -> bool:
    """True if `header` is accepted with these flags; `method` stands for a processor's FLT_EVAL_METHOD."""
    shim = folder / "shim.h"
    shim.write_text(f"#include <float.h>\n#undef FLT_EVAL_METHOD\n#define FLT_EVAL_METHOD {method}\n" if method else "")
    source = folder / "twin.c"
    source.write_text(f'#include "{ROOT / header}"\n')
    command = [
        compiler,
        "-include",
        str(shim),
        *c_extensions.FLAGS,
        "-Wno-unused-function",
        *flags,
        "-fsyntax-only",
        str(source),
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0 or "doubles must be computed" in done.stderr, done.stderr
    return done.returncode == 0


@pytest.mark.parametrize("header", TWINS)
@pytest.mark.parametrize(
    ("method", "sound"),
    [
        *((method, True) for method in ("0", "1", "16", "32", "33", "64")),
        *((method, False) for method in ("2", "-1", "(-2)", "65", "128", "129")),
    ],
)
def test_processors_that_compute_doubles_as_doubles_are_accepted(
    header: str, method: str, sound: bool, tmp_path: Path
) -> None:
    """The standards' values of FLT_EVAL_METHOD are accepted: 16 is that of half-precision arithmetic."""
    if not shutil.which("cc"):
        pytest.skip("no cc")
    assert compiles("cc", header, tmp_path, method=method) == sound


@pytest.mark.parametrize("header", TWINS)
@pytest.mark.parametrize(
    ("compiler", "processor", "flag", "sound"),
    [
        ("cc", "x86_64", "-mavx512fp16", True),
        ("cc", "x86_64", "-mfpmath=387", False),
        ("cc", "", "-ffast-math", False),
        pytest.param("aarch64-linux-gnu-gcc", "", "-march=armv8.2-a+fp16", True, marks=pytest.mark.aarch64),
    ],
)
def test_flags_that_change_how_numbers_are_computed_are_refused(
    header: str, compiler: str, processor: str, flag: str, sound: bool, tmp_path: Path
) -> None:
    """The code is compiled but never run, so the processor need not support the flag."""
    if processor not in ("", os.uname().machine):
        pytest.skip(f"a flag for {processor}")
    empty = tmp_path / "empty.c"
    empty.write_text("")
    if (
        not shutil.which(compiler)
        or subprocess.run([compiler, flag, "-fsyntax-only", empty], stderr=subprocess.DEVNULL).returncode
    ):
        pytest.skip(f"no {compiler}, or one that does not support {flag}")
    assert compiles(compiler, header, tmp_path, flag) == sound
