"""A virtual single-board computer: see `python -m tools.virtual_board --help`."""
