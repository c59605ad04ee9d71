"""DroneCAN protocol of a thruster link: the thrusters are the ESCs of a DroneCAN node."""
