"""Ground floor of the bridge: errors, clocks, TOML to records, option converters, processes, text.

Public: every module here. It imports nothing else of this project.
"""
