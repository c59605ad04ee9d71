"""Faults of the network library (zenoh 1.10.2) that are worked around: each file has a symptom, its report and a test.

The test named in each file fails once the library is corrected: then remove the file. Public: every module here.
They must not know who publishes what.
"""
