"""What a vehicle decides by itself: pure functions and small state machines, no I/O, no clock."""
