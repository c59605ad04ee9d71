"""Pressure sensors at their wire: Keller's series 33X and Paroscientific's Digiquartz.

Public: `keller`, `paroscientific`, the instruments. They must not know wires or the network.
"""
