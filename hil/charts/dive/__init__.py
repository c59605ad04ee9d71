"""A simulated flight over a chart, with its report.

Public: `prepare.prepare_dive`, `watch.DiveWatch`, `report.write_report`. It must not start the flight, which
hil/commands/demo.py does.
"""
