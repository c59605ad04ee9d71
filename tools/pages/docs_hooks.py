"""Hooks of mkdocs: settings and changes of pages that its configuration file cannot express.

Links from a page to the code (`../../hil/cli.py`) work in the repository. The built site has no code, so there the
text of such a link is shown without the link.
"""

import os
import re
from typing import Any

LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((\.\./[^)#\s]+)(#[^)]*)?\)")


def on_config(config: Any) -> Any:
    """Load no script from a server: tools/docs_theme has the one that the offline plugin would load."""
    config.extra["polyfills"] = []
    return config


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Return the page; links to files outside the documentation become plain text."""
    folder = os.path.dirname(page.file.src_uri)

    def plain(link: re.Match[str]) -> str:
        leads_out = os.path.normpath(os.path.join(folder, link[2])).startswith("..")
        return link[1] if leads_out else link[0]

    return LINK.sub(plain, markdown)
