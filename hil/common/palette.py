"""Colours for all pictures, as #rrggbb: the same in plots, in reports and in the live view."""

PATH = "#2563eb"  # planned
TRACK = "#ea580c"  # true
NAVIGATION = "#9333ea"  # estimated by the vehicle's own navigation
COMMANDED = PATH
START = "#0f766e"
GOAL = "#16a34a"
OBSTACLE = "#64748b"
HIDDEN_OBSTACLE = "#a16207"  # not on the planner's map
TETHER = "#ca8a04"
EVENT = "#dc2626"
WATER = "#f3f6f9"
GRID = "0.9"
