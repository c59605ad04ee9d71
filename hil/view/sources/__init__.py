"""Sources of the samples that a view shows: the network, a recording, a simulation."""
