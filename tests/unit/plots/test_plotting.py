"""Properties of all pictures: gaps in missing data."""

from math import isnan

from hil.plots.run_plots import GAP_S, with_gaps


def test_curves_have_gaps_where_data_are_missing() -> None:
    late = 0.2 + 2.0 * GAP_S
    times, (network, control) = with_gaps([0.0, 0.1, 0.2, late], [[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]])
    assert times == [0.0, 0.1, 0.2, 0.2, late]
    for row, values in ((network, [1.0, 2.0, 3.0, 4.0]), (control, [5.0, 6.0, 7.0, 8.0])):
        assert isnan(row[3])
        assert row[:3] + row[4:] == values
