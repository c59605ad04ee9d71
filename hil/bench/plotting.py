"""The door to matplotlib: drawn to files, loaded when a picture is wanted."""

from typing import Any

from hil.errors import MissingExtraError


def pyplot() -> Any:
    """matplotlib.pyplot, without a screen. Raises MissingExtraError."""
    try:
        import matplotlib as mpl
    except ImportError:
        raise MissingExtraError("the picture needs matplotlib: pip install 'uuv-hil[master]'") from None
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    return plt
