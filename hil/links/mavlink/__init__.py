"""MAVLink 2 protocol of a thruster link."""
