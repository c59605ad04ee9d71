"""The camera: its model, and the steps from rays to a picture: light, lamps, particles, motion, image sensor."""
