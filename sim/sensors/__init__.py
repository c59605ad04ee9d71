"""The sensors, one file each; they share one error model and one table of what they send.

Public: `suite.SENSORS`, the table, and `suite.fit`. It must not know messages nor who receives the samples.
"""
