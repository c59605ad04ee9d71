"""The panels beside the scene: instruments, pictures, links, acts, time."""
