"""The subcommands of `uuv-hil` that make recordings, replay them, and draw figures of them."""
