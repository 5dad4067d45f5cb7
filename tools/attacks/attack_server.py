"""Attack a ``physic serve`` of one's own on the loopback, and print how many attacks were tried and how many fell.

    python tools/attacks/attack_server.py [ROW ...]

Each row starts servers with mock estimators in a temporary folder and ends them. Counts and times are bounded: at most
105 connections, 4 GB sent, 60 s of waiting. A row falls where another client is not served, memory exceeds 300 MB, a
photo stays behind, the log has a traceback, or an answer is not the JSON that docs/serve.md promises.
"""

from __future__ import annotations

import contextlib
import http.client
import io
import json
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from physic_testing import build_world

MEMORY_LIMIT_MB = 300
UPLOAD_BYTES = 39_000_000

Row = tuple[int, int, str]  # tried, fell, what was seen


class Server:
    """A server of its own, with its folder, its log and its memory."""

    def __init__(self, folder: Path, *options: str, file_limit: int | None = None) -> None:
        self.folder, self.log = folder, folder.parent / f"{folder.name}.log"
        folder.mkdir(exist_ok=True)
        command = [sys.executable, "-P", "-m", "physic_core", "serve", "--preset", "mock", "--port", "0"]

        def limit() -> None:
            if file_limit:
                resource.setrlimit(resource.RLIMIT_FSIZE, (file_limit, file_limit))

        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                [*command, "--folder", str(folder), *options],
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                preexec_fn=limit,
                env={**os.environ, "TMPDIR": str(folder)},
            )
        assert self.process.stdout is not None
        found = re.search(r":(\d+)/", self.process.stdout.readline())
        assert found, self.log.read_text()
        self.port = int(found[1])
        try:
            self.connect().close()
            self.refused = 0
        except ConnectionRefusedError:
            self.refused = 1
            time.sleep(1)

    def connect(self) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.port), timeout=10)

    def request(self, method: str, place: str, body: bytes | None = None, **headers: str) -> tuple[int, str]:
        """Return status and text; 0 if there was no answer."""
        client = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        try:
            client.request(method, place, body, headers)
            answer = client.getresponse()
            return answer.status, answer.read().decode("utf-8", "replace")
        except (OSError, http.client.HTTPException) as error:
            return 0, repr(error)
        finally:
            client.close()

    def finish(self, posted: tuple[int, str]) -> dict[str, Any]:
        """Wait until a photo has ended, and return its state."""
        if posted[0] != 202:
            return {"state": "refused", "error": f"{posted[0]} {posted[1]}"}
        place = f"/reconstructions/{json.loads(posted[1])['id']}"
        for _ in range(600):
            found: dict[str, Any] = json.loads(self.request("GET", place)[1])
            if found["state"] in ("done", "failed"):
                return found
            time.sleep(0.1)
        return {"state": "not ended", "error": ""}

    def memory_mb(self) -> float:
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        found = re.search(r"VmRSS:\s+(\d+)", status)
        return int(found[1]) / 1000 if found else 0.0

    def workers(self) -> list[int]:
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        threads = Path(f"/proc/{self.process.pid}/task").iterdir()
        children += [child for thread in threads for child in (thread / "children").read_text().split()]
        return sorted({int(c) for c in children if b"spawn_main" in Path(f"/proc/{c}/cmdline").read_bytes()})

    def photos(self) -> list[str]:
        return [str(path) for path in self.folder.rglob("*") if path.is_file() and path.stat().st_size]

    def tracebacks(self) -> int:
        return self.log.read_text().count("Traceback")

    def end(self, *signals: int) -> None:
        for number in signals or (signal.SIGTERM,):
            with contextlib.suppress(ProcessLookupError):
                self.process.send_signal(number)
            time.sleep(0.02)
        try:
            self.process.wait(30)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


@contextlib.contextmanager
def served(folder: Path, *options: str, **settings: Any) -> Iterator[Server]:
    server = Server(folder, *options, **settings)
    try:
        yield server
    finally:
        server.end()


def photo() -> bytes:
    """Return a photo that the mock estimators know."""
    return png(build_world("walk").image)


def png(pixels: Any) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG")
    return buffer.getvalue()


def form(content: bytes) -> tuple[bytes, dict[str, str]]:
    head = b'--b\r\nContent-Disposition: form-data; name="photo"; filename="p.png"\r\n\r\n'
    return head + content + b"\r\n--b--\r\n", {"Content-Type": "multipart/form-data; boundary=b"}


def is_error(answer: tuple[int, str], *statuses: int) -> bool:
    """Whether an answer is one of these statuses with the JSON of an error that names no path."""
    try:
        detail = json.loads(answer[1])["detail"]
    except (ValueError, KeyError, TypeError):
        return False
    return answer[0] in statuses and tempfile.gettempdir() not in detail


def listening(folder: Path) -> Row:
    fell = 0
    for number in range(3):
        with served(folder / str(number)) as server:
            fell += server.refused
    return 3, fell, f"{fell} connections refused right after the address was printed"


def idle_connections(folder: Path) -> Row:
    with served(folder / "s") as server, contextlib.ExitStack() as stack:
        for _ in range(105):
            stack.enter_context(contextlib.closing(server.connect()))
        time.sleep(1)
        at_once = server.request("GET", "/health")[0]
        return 1, at_once != 200, f"another client gets {at_once}, {server.memory_mb():.0f} MB"


def slow_headers(folder: Path) -> Row:
    with served(folder / "s") as server:
        clients = [server.connect() for _ in range(40)]
        closed, statuses = 0, set()
        for client in clients:
            client.sendall(b"GET /health HTTP/1.1\r\nHost: localhost\r\n")
        for _ in range(25):
            statuses.add(server.request("GET", "/health")[0])
            for client in clients:
                with contextlib.suppress(OSError):
                    client.sendall(b"X-A: 1\r\n")
            time.sleep(1)
        for client in clients:
            client.settimeout(0.1)
            try:
                closed += client.recv(1) == b""
            except ConnectionError:
                closed += 1
            except TimeoutError:
                pass
            client.close()
        return 1, closed < 40 or statuses != {200}, f"{closed} of 40 closed after 25 s; another client gets {statuses}"


def unfinished_uploads(folder: Path) -> Row:
    with served(folder / "s") as server:
        clients: list[socket.socket] = []
        start, most, stop = server.memory_mb(), 0.0, threading.Event()

        def send(as_form: bool) -> None:
            kind = "multipart/form-data; boundary=b" if as_form else "image/jpeg"
            head = f"POST /reconstructions HTTP/1.1\r\nHost: localhost\r\nContent-Type: {kind}\r\n"
            content = form(b"\xff\xd8\xff")[0][:-9] if as_form else b"\xff\xd8\xff"
            try:
                client = server.connect()
                clients.append(client)
                client.sendall(f"{head}Content-Length: {UPLOAD_BYTES + 1000}\r\n\r\n".encode() + content)
                sent = 0
                while sent < UPLOAD_BYTES - 1000 and not stop.is_set():
                    client.sendall(bytes(100_000))
                    sent += 100_000
            except OSError:
                pass

        threads = [threading.Thread(target=send, args=(number % 2 == 1,)) for number in range(100)]
        for thread in threads:
            thread.start()
        deadline = time.monotonic() + 40
        while any(thread.is_alive() for thread in threads) and time.monotonic() < deadline:
            most = max(most, server.memory_mb())
            if most > 1000:  # it has fallen: spare the machine
                break
            time.sleep(0.05)
        stop.set()
        answer = server.request("GET", "/health")[0]
        for client in clients:
            with contextlib.suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)
            client.close()
        for thread in threads:
            thread.join()
        time.sleep(2)
        after = server.memory_mb()
        seen = f"{start:.0f} MB before, {'over ' if most > 1000 else ''}{most:.0f} MB during, {after:.0f} MB after"
        fell = max(most, after) > MEMORY_LIMIT_MB or answer != 200
        return 1, fell, f"{seen}; another client gets {answer}"


def endings(folder: Path) -> Row:
    """Signals while photos wait, one is reconstructed and one is being sent."""
    kinds: list[tuple[int, ...]] = [
        (signal.SIGHUP,),
        (signal.SIGTERM,),
        (signal.SIGINT,),
        (signal.SIGHUP, signal.SIGTERM),
    ]
    fallen = []
    for number, signals in enumerate(kinds):
        server = Server(folder / str(number))
        for _ in range(3):
            server.request("POST", "/reconstructions", photo())
        client = server.connect()
        client.sendall(
            b"POST /reconstructions HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9000000\r\n\r\n\xff\xd8\xff"
        )
        client.sendall(bytes(2_000_000))
        server.end(*signals)
        client.close()
        if server.photos() or any(server.folder.iterdir()):
            fallen.append("+".join(signal.Signals(one).name for one in signals))
    return len(kinds), len(fallen), f"files stay after {', '.join(fallen) or 'none'}"


def kill_and_start(folder: Path) -> Row:
    place = folder / "s"
    with served(place) as living:
        dead = Server(place)
        dead.request("POST", "/reconstructions", photo())
        dead.end(signal.SIGKILL)
        left = dead.photos()
        with served(place) as server:
            gone = not any(Path(path).exists() for path in left)
            works = living.finish(living.request("POST", "/reconstructions", photo()))["state"] != "not ended"
            seen = f"{len(left)} files of the dead server, {len(server.photos())} files after the next start"
    return 1, not (left and gone and works), seen


def full_disk(folder: Path) -> Row:
    """Files may have at most 300 kB: first a photo is larger, then a result."""
    fallen = []
    with served(folder / "s", file_limit=300_000) as server:
        large = png(np.random.default_rng(0).integers(0, 256, (700, 700, 3), np.uint8))
        for name, (body, headers) in {"body": (large, {}), "form": form(large)}.items():
            answer = server.request("POST", "/reconstructions", body, **headers)
            if not is_error(answer, 507):
                fallen.append(f"{name}: {answer[0]} {answer[1][:80]!r}")
        found = server.finish(server.request("POST", "/reconstructions", photo()))
        if found["state"] != "failed" or str(folder) in found["error"]:
            fallen.append(f"result: {found['state']} {found['error'][:100]!r}")
        if photos := [path for path in server.photos() if Path(path).name != "lock"]:
            fallen.append(f"stays: {[Path(path).name for path in photos]}")
        if count := server.tracebacks():
            fallen.append(f"{count} tracebacks")
    return 5, len(fallen), "; ".join(fallen)


def idle_worker(folder: Path) -> Row:
    with served(folder / "s") as server:
        states = []
        for pause in (0.0, 3.0):
            for worker in server.workers():
                os.kill(worker, signal.SIGKILL)
            time.sleep(pause)
            found = server.finish(server.request("POST", "/reconstructions", photo()))
            states.append(f"{found['state']} {found['error']}")
        return 2, sum(not state.startswith("done") for state in states), "; ".join(states)


def hang_ups(folder: Path) -> Row:
    with served(folder / "s") as server:
        for number in range(80):
            client = server.connect()
            body, headers = form(photo()) if number % 2 else (photo(), {})
            lines = "".join(f"{name}: {value}\r\n" for name, value in headers.items())
            head = f"POST /reconstructions HTTP/1.1\r\nHost: localhost\r\n{lines}Content-Length: {len(body)}\r\n\r\n"
            client.sendall(head.encode() + body[: len(body) // 2])
            client.close()
        time.sleep(1)
        left, count = server.photos(), server.tracebacks()
        state = server.request("GET", "/health")[1]
        return 80, min(80, count + len(left)), f"{count} tracebacks, {len(left)} photos stay, {state}"


def headers(folder: Path) -> Row:
    hosts = ["[::1", "a b", "localhost:x", "[zz]", "localhost/", "a@localhost", "", "loc\xe4lhost"]
    origins = ["http://[", "http://", "//x", "http://a b", "http://[::1", "x"]
    fallen = []
    with served(folder / "s") as server:
        for host in hosts:
            if not is_error(answer := server.request("GET", "/health", Host=host), 400):
                fallen.append(f"Host {host!r}: {answer[0]}")
        for origin in origins:
            if not is_error(answer := server.request("GET", "/health", Origin=origin), 400):
                fallen.append(f"Origin {origin!r}: {answer[0]}")
        foreign = {"Host": ["evil.example", "localhost.evil.example"], "Origin": ["http://evil.example", "null"]}
        for name, values in foreign.items():
            for value in values:
                if not is_error(answer := server.request("GET", "/health", **{name: value}), 400, 403, 421):
                    fallen.append(f"{name} {value!r}: {answer[0]}")
        if count := server.tracebacks():
            fallen.append(f"{count} tracebacks")
    return len(hosts) + len(origins) + 5, len(fallen), "; ".join(fallen)


ROWS: dict[str, Callable[[Path], Row]] = {
    row.__name__: row
    for row in (
        *(listening, idle_connections, slow_headers, unfinished_uploads, endings),
        *(kill_and_start, full_disk, idle_worker, hang_ups, headers),
    )
}


def main() -> int:
    """Run the rows that are named, or all; return how many fell."""
    wanted = sys.argv[1:] or list(ROWS)
    total = 0
    print(f"{'attack':20} {'tried':>5} {'fell':>4}  seen")
    for name in wanted:
        with tempfile.TemporaryDirectory() as folder:
            tried, fell, seen = ROWS[name](Path(folder))
        total += int(fell)
        print(f"{name:20} {tried:5} {int(fell):4}  {seen}", flush=True)
    return int(total > 0)


if __name__ == "__main__":
    sys.exit(main())
