"""docs/reference/cases.md has the figures of flights with this version of the code."""

import pytest

from hil.cases.case import CASES
from tests.support.flights.cases_page import check_page


@pytest.mark.parametrize("name", CASES)
def test_the_page_has_the_figures_of_a_repeated_flight(name: str) -> None:
    check_page(name)
