"""What is shared by tests but is no test module itself explains its assertions too."""

import pytest

pytest.register_assert_rewrite(
    "tests.links.link_contract", "tests.links.mavlink_peer", "tests.processes", "tests.slave.stm32_contract"
)
