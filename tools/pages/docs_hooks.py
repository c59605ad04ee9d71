"""Hooks of mkdocs: what a page needs beyond its Markdown.

Links from a page to the code (`../../hil/cli.py`) work where the repository is browsed. The built site has no code:
there such a link becomes the text of its name.
"""

import os
import re
from typing import Any

LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((\.\./[^)#\s]+)(#[^)]*)?\)")


def on_config(config: Any) -> Any:
    """Load nothing from elsewhere: tools/docs_theme has the script that the offline plugin would take from a server."""
    config.extra["polyfills"] = []
    return config


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Return the page with links that lead out of the documentation as plain text."""
    folder = os.path.dirname(page.file.src_uri)

    def plain(link: re.Match[str]) -> str:
        leads_out = os.path.normpath(os.path.join(folder, link[2])).startswith("..")
        return link[1] if leads_out else link[0]

    return LINK.sub(plain, markdown)
