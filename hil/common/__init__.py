"""Base of the bridge: errors, clocks, TOML to records, option converters, processes, text.

Public: every module here, and the version of the project. It must not import anything else of this project.
"""

__version__ = "0.1.0"
