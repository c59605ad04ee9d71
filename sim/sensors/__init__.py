"""The sensors, one file each; they share one error model and one table of what they send."""
