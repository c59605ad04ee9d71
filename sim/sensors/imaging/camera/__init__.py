"""The camera: its sensor and model, and how a picture comes out of rays, light, lamps, particles and motion."""
