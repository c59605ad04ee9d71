"""The health of slaves for Prometheus and Grafana.

Public: `endpoint`, `grafana`. It must not command vehicles.
"""
