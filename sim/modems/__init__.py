"""Underwater communication between vehicles by sound or by light."""
