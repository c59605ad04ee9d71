"""The touches of a hull, and the blows it gets: parts of sim/environment/collision.py, which alone uses them."""
