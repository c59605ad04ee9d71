"""The slave's health: measured in a thread of low priority, published as ROS diagnostics.

Public: `reporter.Health`. It must not make the loop wait.
"""
