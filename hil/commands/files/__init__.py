"""The subcommands of `uuv-hil` about files: scenarios, and the JSON Schemas of all files."""
