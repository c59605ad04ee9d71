"""The HIL table: one board's column, and boards side by side.

Public: `run.fly` and `run.figures` make a column, `hil_table` and `boards` report it. It must not know the command that
prints it.
"""
