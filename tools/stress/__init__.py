"""Attack parts of the project with random data and pauses, for longer than a test may take."""
