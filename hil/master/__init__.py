"""The planner's side: the client of a vehicle, and the planner process."""
