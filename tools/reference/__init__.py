"""The reference pages of the documentation, made from the code: `python -m tools.reference` writes docs/reference.

A page is a template in `templates`. In it `@keys module:Record@` stands for the table of a record's keys, and
`@module.function words@` for what a function of this package returns, such as the rows of a table.
"""

import re
from importlib import import_module
from pathlib import Path

from tools.reference.records import keys

TEMPLATES = Path(__file__).parent / "templates"
PART = re.compile(r"@(keys|\w+\.\w+)((?: [\w/.:]+)*)@")


def pages() -> dict[str, str]:
    """Return the text of every generated page, by the name of its file without `.md`."""
    return {path.stem: page(path.stem) for path in sorted(TEMPLATES.glob("*.md"))}


def page(name: str) -> str:
    """Return the text of one page."""
    text = (TEMPLATES / f"{name}.md").read_text(encoding="utf-8")
    titles = re.findall(r"^## (.*)$", text, re.MULTILINE)

    def part(match: re.Match[str]) -> str:
        if match[1] == "keys":
            title = text[: match.start()].rpartition("\n## ")[2].partition("\n")[0]
            return keys(match[2].strip(), title, titles)
        module, _, function = match[1].partition(".")
        made: str = getattr(import_module(f"tools.reference.{module}"), function)(*match[2].split())
        return made.rstrip("\n")

    return PART.sub(part, text).rstrip() + "\n"
