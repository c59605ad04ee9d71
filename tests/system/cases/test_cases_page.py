"""The same as tests/process/cases/test_cases_page.py, for the cases that take longer."""

import pytest

from hil.cases.case import CASES
from tests.support.flights.cases_page import check_page


@pytest.mark.parametrize("name", [name for name in CASES if name != "path_planning"])
def test_the_page_has_the_figures_of_a_repeated_flight(name: str) -> None:
    check_page(name)
