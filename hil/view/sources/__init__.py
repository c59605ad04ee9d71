"""Sources of the samples that a view shows: the network, a recording, a simulation.

Public: the interface `source.Source`, and `live`, `recorded` and `simulated`. It must not draw anything.
"""
