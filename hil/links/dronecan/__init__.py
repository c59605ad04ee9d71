"""DroneCAN protocol of a thruster link: the thrusters are the ESCs of a DroneCAN node.

Public: `link.open_dronecan`, which `hil.links.protocols` names. It must not know the bus that carries its frames.
"""
