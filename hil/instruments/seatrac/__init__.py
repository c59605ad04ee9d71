"""Blueprint Subsea's SeaTrac beacons at their wire: a positioning X150 and a modem X110, and the water between them.

Public: `link`, the instrument; also `beacon`. They must not know wires or the network.
"""
