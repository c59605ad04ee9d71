"""Three-dimensional scene of the live view, and the server that draws it (viser)."""
