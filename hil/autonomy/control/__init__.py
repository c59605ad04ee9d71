"""Controllers, thruster allocation, and the vehicle model that they use."""
