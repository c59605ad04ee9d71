"""Addresses to listen at that this machine does not have yet."""

import logging
import sys

import pytest

from hil.common.web.late_address import late_socket


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux listens at an address that is not there")
def test_an_address_that_is_not_there_is_listened_at_and_reported(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        opened = late_socket("198.51.100.7", 0)  # of an example network (RFC 5737)
    assert opened
    with opened:
        assert opened.getsockname()[0] == "198.51.100.7"
    assert "198.51.100.7:0: waiting for it" in caplog.text
    assert late_socket("127.0.0.1", 0) is None
