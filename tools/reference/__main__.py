"""Write the reference pages: python -m tools.reference [--results FOLDER]."""

import argparse
from pathlib import Path

from tools.reference import pages, status

FOLDER = Path(__file__).parents[2] / "docs" / "reference"

if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="tools.reference", description="Write the reference pages.")
    parser.add_argument("--results", type=Path, metavar="FOLDER", help="results of `python -m tools.check --results`")
    if folder := parser.parse_args().results:
        status.merge(folder)
    for name, text in pages().items():
        (FOLDER / f"{name}.md").write_text(text, encoding="utf-8")
        print(FOLDER / f"{name}.md")
