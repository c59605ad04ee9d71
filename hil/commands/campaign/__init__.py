"""`uuv-hil campaign`: many runs on all processors of this machine or of a cluster."""
