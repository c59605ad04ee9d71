"""Commands that serve vehicles to the software of others: JSON lines, Foxglove, MAVLink."""
