"""Real sockets on the loopback, with a scripted worker."""

from __future__ import annotations

import re
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from typing import Any

import pytest
import uvicorn

from physic_serve.connections import make_server
from physic_serve.worker import Message, Task

from .conftest import PHOTO, Served

Address = tuple[str, int]
Listen = Callable[..., "Listening"]
REQUEST = b"GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"


@dataclass(frozen=True)
class Listening:
    """A server, and where it listens."""

    served: Served
    server: uvicorn.Server
    address: Address


@pytest.fixture
def listen(serve: Callable[..., Served]) -> Iterator[Listen]:
    """Start a server with these limits, and return it; ends with the test."""
    ended = []

    def start(**limits: Any) -> Listening:
        served = serve(**limits)
        server = make_server(served.app, "127.0.0.1", 0, served.jobs.limits)
        sock = server.config.bind_socket()
        sock.listen()
        thread = threading.Thread(target=server.run, args=([sock],))
        thread.start()
        ended.append((server, thread))
        return Listening(served, server, sock.getsockname())

    yield start
    for server, thread in ended:
        server.should_exit = True
        thread.join()


def connect(address: Address, source: str = "127.0.0.1") -> closing[socket.socket]:
    return closing(socket.create_connection(address, timeout=60, source_address=(source, 0)))


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
    with connect(listen(head_s=0.2).address) as client:
        client.sendall(begun)
        assert ended(client)


def test_a_connection_is_closed_some_time_after_its_response(listen: Listen):
    with connect(listen(head_s=0.2).address) as client:
        client.sendall(REQUEST)
        assert client.recv(1000).startswith(b"HTTP/1.1 200 OK")
        client.sendall(b"GET")
        assert ended(client)


def test_the_longest_idle_connection_makes_room(listen: Listen):
    address = listen(connections=2, head_s=3600).address
    with connect(address) as first, connect(address) as second, connect(address) as third:
        third.sendall(REQUEST)
        assert third.recv(1000).startswith(b"HTTP/1.1 200 OK")
        second.sendall(REQUEST)
        assert second.recv(1000).startswith(b"HTTP/1.1 200 OK")
        assert ended(first)


def request(path: str, more: str = "", method: str = "GET") -> bytes:
    return f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n{more}\r\n".encode()


def read_until(client: socket.socket, words: bytes) -> bytes:
    found = b""
    while words not in found:
        found += (part := client.recv(1000))
        assert part, found
    return found


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere 127.0.0.2 is not an address of this machine")
def test_readers_of_events_do_not_stop_another_user(listen: Listen):
    found = listen(connections=4)
    events = request(f"/reconstructions/{found.served.post().json()['id']}/events")
    with ExitStack() as opened:
        mine = opened.enter_context(connect(found.address))
        mine.sendall(events)
        for _ in range(8):
            other = opened.enter_context(connect(found.address, "127.0.0.2"))
            other.sendall(events)
            read_until(other, b"event: stage")
        found.served.release.set()
        read_until(mine, b"event: done")


def test_trickling_uploads_do_not_stop_another_user(listen: Listen):
    found = listen(queue=8)
    head = request("/reconstructions", "Content-Length: 100000\r\nExpect: 100-continue\r\n", "POST")
    found.served.release.set()
    with ExitStack() as opened:
        for _ in range(9):
            other = opened.enter_context(connect(found.address))
            other.sendall(head)
            read_until(other, b"100 Continue")  # the upload has begun
        posted = opened.enter_context(connect(found.address))
        posted.sendall(request("/reconstructions", f"Content-Length: {len(PHOTO)}\r\n", "POST") + PHOTO)
        name = re.search(rb"/reconstructions/([\w-]+)\r", read_until(posted, b'"files"'))
        assert found.served.wait(name[1].decode())["state"] == "done"


def test_a_client_that_does_not_read_is_closed(listen: Listen):
    found = listen(head_s=0.2)
    size = 30_000_000  # more than the buffers of two sockets
    posted = found.served.post().json()["id"]
    found.served.wait(posted, "running")

    def write(task: Task) -> Message:
        (task.folder / "points.ply").write_bytes(bytes(size))
        return Message("done", {})

    found.served.workers[0].outcome = write
    found.served.release.set()
    found.served.wait(posted)
    with connect(found.address) as client:
        client.sendall(request(f"/reconstructions/{posted}/files/points.ply"))
        assert client.recv(10).startswith(b"HTTP/1.1 2")
        for _ in range(3000):
            if not found.server.server_state.connections:
                break
            time.sleep(0.01)
        count = 0
        while part := client.recv(100_000):
            count += len(part)
        assert count < size
