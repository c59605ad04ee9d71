"""The faults of the campaign, one file for each of what fails: how each begins and ends, and on which links.

Public: `FAULTS` of each module, and `BAD_FILES` of `file`. They must not know how a row is measured.
"""
