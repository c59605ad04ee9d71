"""A card computer that is not there: see `python -m tools.virtual_board --help`."""
