"""VESC protocol of a thruster link: the thrusters are motors of VESC controllers on a CAN bus.

Public: `link.open_vesc`, which `hil.links.protocols` names. It must not know the bus that carries its frames.
"""
