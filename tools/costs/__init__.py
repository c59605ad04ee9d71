"""Measure what parts of the project cost in time, processor and memory, on an otherwise idle machine."""
