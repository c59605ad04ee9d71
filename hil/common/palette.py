"""Colours of all pictures, as #rrggbb, that colour-blind readers tell apart.

Lines and marks: M. Okabe and K. Ito, Color Universal Design (2008). In grey print dashes and marks tell them apart.
"""

SERIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#6b7280")  # curves, in their order
PATH = SERIES[0]  # planned
TRACK = SERIES[1]  # true
NAVIGATION = SERIES[3]  # estimated by the vehicle's own navigation
COMMANDED = PATH
START = "#111827"
GOAL = SERIES[2]
OBSTACLE = "#475569"
HIDDEN_OBSTACLE = SERIES[5]  # not on the planner's map
TETHER = SERIES[4]
EVENT = "#111827"
WATER = "#eef5fa"
LAND = "#d9c69a"
CLOSED = "#cfd6de"  # where the planner plans no path
GRID = "0.9"
