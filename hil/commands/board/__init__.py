"""`uuv-hil board` and its subcommands."""
