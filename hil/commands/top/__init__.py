"""`uuv-hil top`: show the health of all slaves, as a table and as a Prometheus endpoint."""
