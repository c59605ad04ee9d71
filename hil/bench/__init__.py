"""What it costs: the HIL table."""
