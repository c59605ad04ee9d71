"""docs/explanation/cases.md tells of flights of this tree, not of an older one."""

import pytest

from tests.support.flights.cases_page import check_page


@pytest.mark.parametrize("name", ["path_planning"])
def test_the_page_has_the_figures_of_its_flights(name: str) -> None:
    check_page(name)
