"""The subcommands of `uuv-hil`: arguments in, a room's function, text out; a folder where one has subcommands.

Public: `main(arguments)` of each module that `hil/cli.py` names. No other room imports them.
"""
