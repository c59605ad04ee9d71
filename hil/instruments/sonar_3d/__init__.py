"""The Water Linked Sonar 3D-15: its images by UDP, and its settings by HTTP.

Public: `sonar`, the instrument. They must not know wires or the network.
"""
