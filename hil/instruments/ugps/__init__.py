"""The Water Linked Underwater GPS G2, which locates a vehicle from the surface: its interface of HTTP.

Public: `topside`, the instrument. They must not know wires or the network.
"""
