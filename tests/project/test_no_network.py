"""Tests of this repository use no network."""

from __future__ import annotations

import socket

import pytest


@pytest.mark.parametrize("host", ["192.0.2.1", "example.org", "10.0.0.1"])
def test_a_test_that_uses_the_network_fails(host):
    message = f"^the test uses the network: '{host}'$"
    with pytest.raises(pytest.fail.Exception, match=message):
        socket.create_connection((host, 80), timeout=0.1)
    with pytest.raises(pytest.fail.Exception, match=message):
        socket.gethostbyname(host)
    with socket.socket() as own, pytest.raises(pytest.fail.Exception, match=message):
        own.connect((host, 80))
    with socket.socket() as own, pytest.raises(pytest.fail.Exception, match=message):
        own.connect_ex((host, 80))


def test_a_server_on_this_machine_can_be_used():
    with socket.create_server(("127.0.0.1", 0)) as server:
        socket.create_connection(server.getsockname()).close()
        server.accept()[0].close()
