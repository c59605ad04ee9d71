"""The simulator: vehicle, water, obstacles and sensors. No input or output, no threads, no clock: time comes in."""
