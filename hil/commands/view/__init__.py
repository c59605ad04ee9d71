"""`uuv-hil view`, and the view as a part of other commands."""
