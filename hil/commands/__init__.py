"""The subcommands of `uuv-hil`: arguments in, a room's function, text out.

A subcommand is a module, or a folder where it has subcommands itself; `recording` holds those of recordings.
Public: `main(arguments)` of each module that `hil/cli.py` names, and `completion`. It must not compute what another
program could want: no other room imports it.
"""
