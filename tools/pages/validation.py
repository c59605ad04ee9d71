"""Compare the simulator with published data and with theory: the page validation.md and its pictures.

    python tools/pages/validation.py [--out docs/reference] [--only NAME ...]

Each run computes every figure again. A figure outside its bound ends the run with exit code 1, and
tests/system/tools/test_validation.py does the same. Needs the packages of `pip install -e '.[dev]'`.
"""

import argparse
import sys
import time
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from PIL import Image

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))
mpl.use("Agg")

from matplotlib import pyplot as plt  # noqa: E402 - after the backend is chosen

from tools.reference.records import anchor  # noqa: E402
from tools.validations import (  # noqa: E402 - works from a bare checkout too
    bluerov2,
    devices,
    navigation,
    remus,
    thrusters,
    vessels,
    water,
)
from tools.validations.sheet import Finding, Sheet  # noqa: E402

PARTS = (bluerov2, remus, vessels, thrusters, water, devices, navigation)
SHEETS: list[Sheet] = [sheet for part in PARTS for sheet in part.SHEETS]
STYLE: Any = {"font.size": 8, "axes.titlesize": 8, "legend.fontsize": 7, "lines.linewidth": 1.2, "savefig.dpi": 120}
COLOURS = 64
HEAD = Path(__file__).with_suffix(".md").read_text(encoding="utf-8")


def draw(sheet: Sheet, path: Path) -> list[Finding]:
    """Save the picture of `sheet` at `path`; return its findings."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(sheet.rows, sheet.columns, figsize=sheet.size, layout="constrained", squeeze=False)
        findings = sheet.draw(axes.ravel().tolist())
        save(figure, path)
    return findings


def save(figure: Figure, path: Path) -> None:
    """Save the figure as a PNG of few colours, a third of the bytes."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png")
    plt.close(figure)
    Image.open(buffer).convert("RGB").quantize(COLOURS).save(path, optimize=True)


def page(by_sheet: dict[Sheet, list[Finding]]) -> str:
    """Return the text of validation.md."""
    rows = [_row(sheet, findings[0]) for sheet, findings in by_sheet.items()]
    return HEAD + "\n".join(rows) + "\n" + "".join(_section(sheet, findings) for sheet, findings in by_sheet.items())


def _row(sheet: Sheet, main: Finding) -> str:
    title = f"[{sheet.title}](#{anchor(sheet.title)})"
    return f"| {title} | {main.what} | {main.result} | {main.bound} |"


def _section(sheet: Sheet, findings: list[Finding]) -> str:
    text = " ".join((sheet.draw.__doc__ or "").split())
    rows = [f"| {f.what} | {f.result} | {f.bound} |" for f in findings]
    lines = ["| figure | found | bound |", "|---|---|---|", *rows]
    picture = f"![{sheet.title}](validation/{sheet.name}.png)"
    return "\n".join(["", f"## {sheet.title}", "", text, "", *lines, "", picture, ""])


def main(arguments: list[str] | None = None) -> None:
    """Draw the sheets; write the page if all sheets are drawn and all figures are within their bounds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--out", type=Path, default=ROOT / "docs" / "reference", help="folder of the page [%(default)s]"
    )
    parser.add_argument(
        "--only", nargs="+", metavar="NAME", default=[], help="draw only these pictures, and do not write the page"
    )
    options = parser.parse_args(arguments)
    chosen = [sheet for sheet in SHEETS if not options.only or sheet.name in options.only]
    (options.out / "validation").mkdir(parents=True, exist_ok=True)
    by_sheet = {}
    for sheet in chosen:
        start = time.perf_counter()
        by_sheet[sheet] = draw(sheet, options.out / "validation" / f"{sheet.name}.png")
        print(f"{sheet.name} ({time.perf_counter() - start:.1f} s)", flush=True)
        for finding in by_sheet[sheet]:
            print(f"  {'' if finding.holds else 'BEYOND: '}{finding.what}: {finding.result}, bound {finding.bound}")
    beyond = sum(not finding.holds for findings in by_sheet.values() for finding in findings)
    if beyond:
        sys.exit(f"{beyond} beyond the bounds: the page is not written")
    if not options.only:
        (options.out / "validation.md").write_text(page(by_sheet), encoding="utf-8")


if __name__ == "__main__":
    main()
