"""Hooks of mkdocs: settings and changes of pages that its configuration file cannot express.

Links from a page to the code (`../../hil/cli.py`) work in the repository. The built site has no code, so there the
text of such a link is shown without the link. The search puts pages that teach before those that list.
"""

import os
import re
from typing import Any

BOOST = {"tutorials": 4.0, "how-to": 3.0, "explanation": 2.0}
WEIGHTS = {
    "tutorials/own_planner.md": 8.0,
    "reference/python_api.md": 0.2,
    "reference/commands.md": 0.2,
    "reference/status.md": 0.2,
}
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((\.\./[^)#\s]+)(#[^)]*)?\)")


def on_config(config: Any) -> Any:
    """Load no script from a server: tools/docs_theme has the one that the offline plugin would load."""
    config.extra["polyfills"] = []
    return config


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Return the page; links to files outside the documentation become plain text. Weigh it in the search."""
    folder = os.path.dirname(page.file.src_uri)
    weight = WEIGHTS.get(page.file.src_uri, BOOST.get(folder, 1.0))
    page.meta.setdefault("search", {"exclude": True} if folder == "upstream" else {"boost": weight})

    def plain(link: re.Match[str]) -> str:
        leads_out = os.path.normpath(os.path.join(folder, link[2])).startswith("..")
        return link[1] if leads_out else link[0]

    return LINK.sub(plain, markdown)
