"""Links in the repository lead to files and their anchors to headings; prose is wrapped and states no history."""

import re
import unicodedata
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [*ROOT.glob("*.md"), *sorted((ROOT / "docs").rglob("*.md"))]
FENCED = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
GENERATED = re.compile(r"(?i:made by) `python|^`python tools/[\w/]+\.py` makes this page", re.MULTILINE)
WIDTH = 120
# A page states the present and not earlier versions, which a reader cannot check.
HISTORY = re.compile(r"\b(was once|were once|no longer has|has been fixed|until recently|since then)\b")
NAMED_FILE = re.compile(r"`((?:tests|tools|hil|sim|boards|firmware_stub)/[\w/]+\.(?:py|toml|c|h))[`:]")


def links(page: Path) -> list[str]:
    text = FENCED.sub("", page.read_text(encoding="utf-8"))
    found = re.findall(r"\]\(([^)\s]+)\)", text)
    return [target for target in found if "://" not in target and not target.startswith("mailto:")]


@cache
def anchors(page: Path) -> frozenset[str]:
    """Return the anchors of a page's headings, as Python-Markdown makes them."""
    text = FENCED.sub("", page.read_text(encoding="utf-8"))
    headings = re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)
    return frozenset(slug(re.sub(r"\[([^]]*)\]\([^)]*\)|`", r"\1", heading)) for heading in headings)


def slug(heading: str) -> str:
    plain = unicodedata.normalize("NFKD", heading).encode("ascii", "ignore").decode()
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip().lower())


def test_links_lead_to_files_and_headings() -> None:
    for page in PAGES:
        for target in links(page):
            path, _, anchor = target.partition("#")
            file = (page.parent / path).resolve() if path else page
            assert file.exists(), f"{page.name}: {target}"
            if anchor and file.suffix == ".md":
                assert anchor in anchors(file), f"{page.name}: {target}; {file.name} has {sorted(anchors(file))}"


def test_every_page_is_in_the_navigation() -> None:
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    named = set(re.findall(r": ([\w/-]+\.md)$", text, flags=re.MULTILINE))
    pages = {page.relative_to(ROOT / "docs").as_posix() for page in (ROOT / "docs").rglob("*.md")}
    assert named == {page for page in pages if not page.startswith("upstream/")}


def prose(page: Path) -> list[str]:
    """Return the lines of a page that a person wraps: no code, no table, no picture."""
    lines = FENCED.sub("", page.read_text(encoding="utf-8")).splitlines()
    return [line for line in lines if not line.startswith(("|", "    ", "![", "[!["))]


def test_prose_is_wrapped_and_states_no_history() -> None:
    for page in PAGES:
        lines = prose(page)
        is_by_hand = not GENERATED.search("\n".join(lines[:12]))
        assert not [line for line in lines if is_by_hand and len(line) > WIDTH], page.name
        assert page.name == "CHANGELOG.md" or not [line for line in lines if HISTORY.search(line)], page.name


def test_generated_pages_are_recognised() -> None:
    found = {page.stem for page in PAGES if GENERATED.search("\n".join(prose(page)[:12]))}
    assert {"cases", "validation", "scenario", "vehicle", "sensors"} <= found
    assert not found & {"benchmark", "reliability", "security", "links", "tests", "README"}


def test_files_that_a_page_names_exist() -> None:
    for page in PAGES:
        for named in NAMED_FILE.findall(page.read_text(encoding="utf-8")):
            assert (ROOT / named).is_file() or Path(named).stem.isupper(), f"{page.name}: {named}"
