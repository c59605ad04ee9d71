"""Where a hull touches things, and the blow it gets: parts of sim/environment/collision.py, which alone uses them."""
