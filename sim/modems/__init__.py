"""Talk under water: what becomes of a message between vehicles, by sound or by light."""
