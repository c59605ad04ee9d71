"""Controllers, thruster allocation and the model they compute with."""
