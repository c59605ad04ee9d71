"""The contract is not a test module itself, but its assertions shall explain themselves too."""

import pytest

pytest.register_assert_rewrite("tests.links.link_contract")
