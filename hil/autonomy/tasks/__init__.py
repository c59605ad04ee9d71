"""The task scheduler and the state charts it is made of."""
