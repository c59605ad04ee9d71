"""The reference pages of the documentation, made from the code: `python -m tools.reference` writes docs/reference."""

from tools.reference import commands, diagnostics, faults, files, instruments, mavlink, sensors, status, stm32, topics


def pages() -> dict[str, str]:
    """Return the text of every generated page, by the name of its file without `.md`."""
    file_pages = {name: page() for name, page in files.PAGES.items()}
    return file_pages | {
        "commands": commands.page(),
        "topics": topics.page(),
        "diagnostics": diagnostics.page(),
        "faults": faults.page(),
        "instruments": instruments.page(),
        "mavlink": mavlink.page(),
        "sensors": sensors.page(),
        "status": status.page(),
        "stm32": stm32.page(),
    }
