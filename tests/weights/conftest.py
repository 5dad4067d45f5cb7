from __future__ import annotations

import hashlib
import threading
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from physic_core.errors import DownloadError
from physic_core.weights import WeightSet
from physic_setup.fetch import fetch

CONTENT = bytes(range(256)) * 4096  # 1 MB
HASH = hashlib.sha256(CONTENT).hexdigest()


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    """A user's folder for caches and one of Hugging Face's, both of the test alone; no folder of
    the user's own.
    """
    from huggingface_hub import constants

    monkeypatch.delenv("PHYSIC_WEIGHTS", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hub"))
    return tmp_path / "cache" / "physic" / "weights"


def weights(*files, **keys):
    """Return a set named net."""
    known = {
        "summary": "",
        "license": "MIT",
        "commercial": True,
        "account": False,
        "homepage": "",
        "advice": "",
    }
    return WeightSet(name="net", files=files, **(known | keys))


class Lists:
    """A plugin's folder of TOML files, written table by table."""

    def __init__(self, folder):
        self.folder = folder
        folder.mkdir()

    def add(self, name, *files, **keys):
        """Add a set in a file of its own; return the folder."""
        keys = {"summary": f"The {name} weights", "license": "MIT", "commercial": True} | keys
        lines = [
            f'["{name}"]',
            *(f"{key} = {_toml(v)}" for key, v in keys.items() if v is not None),
        ]
        for file in files:
            lines += [f'[["{name}".files]]', *(f"{key} = {_toml(v)}" for key, v in file.items())]
        (self.folder / f"{name}.toml").write_text("\n".join(lines) + "\n")
        return self.folder


def _toml(value):
    return str(value).lower() if isinstance(value, bool) else repr(value)


@pytest.fixture
def lists(tmp_path):
    return Lists(tmp_path / "lists")


@dataclass
class Page:
    """One file of the server.

    Attributes:
        content: of the file.
        etag: its tag; none where empty.
        status: of every answer, where it is not a file.
        headers: more of them.
        cut: bytes after which the first connection is dropped.
    """

    content: bytes = b""
    etag: str = ""
    status: int = 200
    headers: dict[str, str] = field(default_factory=dict)
    cut: int = 0


class Server:
    """A web server on this machine alone, that remembers what it was asked."""

    def __init__(self):
        self.pages = {}
        self.asked = []
        self._http = ThreadingHTTPServer(("127.0.0.1", 0), partial(Handler, self))
        self._http.handle_error = lambda request, address: None  # who asked has gone
        self.address = f"http://127.0.0.1:{self._http.server_port}"
        threading.Thread(
            target=self._http.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True
        ).start()

    def add(self, path, content=b"", **more):
        """Serve a file; return its address."""
        self.pages[path] = Page(content, **more)
        return self.address + path

    def close(self):
        self._http.shutdown()
        self._http.server_close()


class Handler(BaseHTTPRequestHandler):
    """Answers one connection."""

    def __init__(self, server, *connection):
        self.own = server
        super().__init__(*connection)

    def log_message(self, *arguments):
        pass

    def do_HEAD(self):
        path = self.path.partition("?")[0]
        self.own.asked.append((self.command, path, dict(self.headers.items())))
        page = self.own.pages.get(path, Page(status=404))
        self.send_response(page.status)
        headers = {"ETag": page.etag} if page.etag else {}
        for header in (page.headers | headers | {"Content-Length": len(page.content)}).items():
            self.send_header(*map(str, header))
        self.end_headers()
        return page

    def do_GET(self):
        page = self.do_HEAD()
        with suppress(ConnectionError):  # who asked has gone
            self.wfile.write(page.content[: page.cut or None])
        page.cut = 0


def refusal(chosen, **settings):
    """The message with which a set is not fetched."""
    with pytest.raises(DownloadError) as caught:
        fetch(chosen, **settings)
    return str(caught.value)


def left(folder):
    """What lies in a folder, hidden files included, but for locks of Hugging Face's library."""
    return sorted(
        str(path.relative_to(folder))
        for path in folder.rglob("*")
        if path.is_file() and ".locks" not in path.parts
    )


@pytest.fixture
def server(monkeypatch):
    monkeypatch.setenv("NO_PROXY", "127.0.0.1,localhost")
    running = Server()
    yield running
    running.close()
