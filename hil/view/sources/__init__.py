"""Where the samples come from that a view shows: the network, a recording, a simulation."""
