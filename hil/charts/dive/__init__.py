"""A simulated flight over a chart, with its report."""
