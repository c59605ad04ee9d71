"""`uuv-hil bench` and its subcommands."""
