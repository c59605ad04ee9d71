"""The bridge: every byte between a card computer, a planner and the simulator."""

__version__ = "0.1.0"
