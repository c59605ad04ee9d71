"""`uuv-hil top`: the health of all slaves, as a table and as a Prometheus endpoint."""
