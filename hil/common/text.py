"""Clean text from others for a terminal or a log: no control characters, limited length."""

LONGEST = 200  # characters that one name or one value of somebody else may take in a line
ELLIPSIS = "..."


def clean(text: str, most: int = LONGEST) -> str:
    """`text` on one line of at most `most` characters, with "?" for what does not print, such as escape sequences."""
    if len(text) > most:
        text = text[: most - len(ELLIPSIS)] + ELLIPSIS
    return text if text.isprintable() else "".join([c if c.isprintable() else "?" for c in text])
