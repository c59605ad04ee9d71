"""A single-board computer that is not there: see `python -m tools.virtual_board --help`."""
