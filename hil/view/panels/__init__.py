"""The panels beside the scene: instruments, pictures, links, actions, time."""
