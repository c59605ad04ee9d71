"""What is drawn in three dimensions, and the server that draws it (viser)."""
