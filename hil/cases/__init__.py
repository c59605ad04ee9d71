"""The source paper's cases, in the simulation and with slaves on the network, and what is measured of them."""
