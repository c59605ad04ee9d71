"""`uuv-hil stm32` and its subcommands."""
