from __future__ import annotations

import hashlib
import os
import threading
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest

from physic_core.cli.output import toml_value
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
    known = {"summary": "", "license": "MIT", "commercial": True}
    return WeightSet(name="net", files=files, **(known | keys))


@pytest.fixture
def add_list(tmp_path):
    """A function that writes a set of weights to a TOML file of its own in a plugin's folder, and
    returns the folder.
    """
    folder = tmp_path / "lists"
    folder.mkdir()

    def add(name, *files, **keys):
        known = {"summary": f"The {name} weights", "license": "MIT", "commercial": True}
        table = {**known, **keys, "files": list(files)}
        lines = [f"{key} = {toml_value(v)}" for key, v in table.items() if v is not None]
        (folder / f"{name}.toml").write_text("\n".join([f'["{name}"]', *lines]))
        return folder

    return add


COMMIT = "c" * 40
ADDED = np.arange(400, dtype=np.float32)


def toy_graph(*names):
    """Return the bytes of a graph that adds to its input the numbers of files of these names."""
    import onnx

    ports = [onnx.helper.make_tensor_value_info(name, 1, [400]) for name in "xy"]
    tensors = []
    for name in names:
        tensors.append(onnx.numpy_helper.from_array(ADDED, f"numbers of {name}"))
        onnx.external_data_helper.set_external_data(tensors[-1], name)
        tensors[-1].ClearField("raw_data")
    nodes = [onnx.helper.make_node("Sum", ["x", *(one.name for one in tensors)], ["y"])]
    graph = onnx.helper.make_graph(nodes, "toy", ports[:1], ports[1:], tensors)
    opset = onnx.helper.make_opsetid("", 14)
    return onnx.helper.make_model(graph, opset_imports=[opset], ir_version=8).SerializeToString()


def write(path, content=b"weights"):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


@pytest.fixture
def lay(tmp_path):
    """A function that writes a file as the library lays its cache, and returns its path: a link of
    a revision to a file named after its digest.
    """

    def lay(origin, content=b"weights"):
        repository = tmp_path / "hub" / f"models--{origin.repository.replace('/', '--')}"
        revision = COMMIT if origin.revision == "main" else origin.revision
        write(repository / "refs" / "main", COMMIT.encode())
        blob = write(repository / "blobs" / hashlib.sha256(content).hexdigest(), content)
        link = repository / "snapshots" / revision / origin.path
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(os.path.relpath(blob, link.parent))
        return link

    return lay


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
