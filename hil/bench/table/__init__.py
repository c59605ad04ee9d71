"""The HIL table: one board's column, and boards side by side."""
