"""The subcommands of `uuv-hil`, one file each."""
