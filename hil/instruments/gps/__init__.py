"""A satellite receiver at its wire: NMEA 0183 and UBX, as a u-blox of the ninth generation speaks them.

Public: `receiver`, the instrument; also `sky`. They must not know wires or the network.
"""
