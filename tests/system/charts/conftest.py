"""Where charts are read, for tests that choose it."""

from tests.support.charts.in_process import charts_in_process, own_process  # noqa: F401
