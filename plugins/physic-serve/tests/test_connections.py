"""Real sockets on the loopback, with a scripted worker."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import pytest

from physic_serve.connections import make_server

from .conftest import Served

Listen = Callable[..., tuple[str, int]]
REQUEST = b"GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"


@pytest.fixture
def listen(serve: Callable[..., Served]) -> Iterator[Listen]:
    """Start a server with these limits, and return its address; ends with the test."""
    ended = []

    def start(**limits: Any) -> tuple[str, int]:
        served = serve(**limits)
        server = make_server(served.app, "127.0.0.1", 0, served.jobs.limits)
        sock = server.config.bind_socket()
        sock.listen()
        thread = threading.Thread(target=server.run, args=([sock],))
        thread.start()
        ended.append((server, thread))
        address: tuple[str, int] = sock.getsockname()
        return address

    yield start
    for server, thread in ended:
        server.should_exit = True
        thread.join()


def connect(address: tuple[str, int]) -> closing[socket.socket]:
    return closing(socket.create_connection(address, timeout=60))


def ended(client: socket.socket) -> bool:
    """Wait until the server closes a connection; a time limit of the socket is an error."""
    try:
        while client.recv(1000):
            pass
    except ConnectionResetError:
        pass
    return True


@pytest.mark.parametrize("begun", [b"", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"], ids=["nothing", "half a head"])
def test_a_connection_without_a_complete_head_is_closed(listen: Listen, begun: bytes):
    with connect(listen(head_s=0.2)) as client:
        client.sendall(begun)
        assert ended(client)


def test_a_connection_is_closed_some_time_after_its_response(listen: Listen):
    with connect(listen(head_s=0.2)) as client:
        client.sendall(REQUEST)
        assert client.recv(1000).startswith(b"HTTP/1.1 200 OK")
        client.sendall(b"GET")
        assert ended(client)


def test_the_oldest_connection_without_a_request_makes_room(listen: Listen):
    address = listen(connections=2, head_s=3600)
    with connect(address) as first, connect(address) as second, connect(address) as third:
        third.sendall(REQUEST)
        assert third.recv(1000).startswith(b"HTTP/1.1 200 OK")
        second.sendall(REQUEST)
        assert second.recv(1000).startswith(b"HTTP/1.1 200 OK")
        assert ended(first)
