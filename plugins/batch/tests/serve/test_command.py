"""The command: an address that cannot be used is refused before any model is loaded."""

from __future__ import annotations

import socket

import pytest


@pytest.fixture
def used_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def test_a_port_in_use_is_refused_with_its_option(used_port, physic):
    done = physic("serve", "--preset", "mock", "--port", str(used_port))
    assert done.exit_code == 2
    assert f"--port {used_port}" in done.output
    assert "loading" not in done.output
