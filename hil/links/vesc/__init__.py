"""VESC protocol of a thruster link: the thrusters are motors of VESC controllers on a CAN bus."""
