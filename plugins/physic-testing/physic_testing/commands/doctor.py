"""The command ``physic plugins doctor``: load every installed backend, each in a separate process.

A backend that crashes, hangs, or uses all memory does not affect the others.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
import tempfile
import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from multiprocessing import connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from physic_core.batch.workers import started_processes
from physic_core.cli.arguments import Device, Number, require_interface, with_current_folder
from physic_core.cli.exit_codes import BACKEND
from physic_core.cli.output import echo, echo_json
from physic_core.discovery.backends import (
    find_by_name,
    list_backends,
    load_class,
    missing_requirements,
)
from physic_core.discovery.error_text import describe_error, is_debugging, traceback_text
from physic_core.discovery.plugin_code import plugin_code
from physic_core.discovery.plugins import broken_plugins
from physic_core.errors import PhysicError

if TYPE_CHECKING:
    from physic_core.discovery.entry_points import Offer

_AT_ONCE = 2
"""Backends that are loaded at the same time; more could take more memory than the machine has."""

_ANSWER = "answer.json"
_OUTPUT = "output.txt"


@dataclass(frozen=True)
class DoctorResult:
    """Result of the attempt to load one backend.

    Attributes:
        interface: "metric_depth", ...; "-" for a broken plugin.
        backend: name of the backend; "-" for a broken plugin.
        owner: distribution and version.
        state: "ok"; "missing" if the backend itself reports missing files; "broken" for all other
            errors.
        message: what is missing or broken.
        seconds: time to import, construct, load and close the backend.
        traceback: traceback of the exception if ``PHYSIC_DEBUG`` is set; else "".
    """

    interface: str
    backend: str
    owner: str
    state: Literal["ok", "missing", "broken"]
    message: str = ""
    seconds: float = 0.0
    traceback: str = ""

    def __str__(self) -> str:
        end = f"{self.seconds:.1f} s" if self.state == "ok" else self.message
        line = (
            f"{self.state.upper() if self.state == 'broken' else self.state:<8} {self.title}: {end}"
        )
        return "\n".join(filter(None, (line, self.traceback.rstrip("\n"))))

    @property
    def title(self) -> str:
        """Interface, name and distribution of the backend, for messages."""
        return (
            self.owner
            if self.backend == "-"
            else f"{self.interface} '{self.backend}' ({self.owner})"
        )


@click.command()
@click.argument("name", required=False)
@click.option("--interface", metavar="NAME", help="Only backends of this interface.")
@click.option(
    "--device",
    type=Device(),
    default="cpu",
    show_default=True,
    metavar="NAME",
    help="cpu, cuda or cuda:N.",
)
@click.option(
    "--timeout",
    type=Number(1, 10_000_000),
    default=300.0,
    show_default=True,
    metavar="SECONDS",
    help="Time limit for each backend.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON.")
@click.pass_context
def doctor(
    ctx: click.Context,
    name: str | None,
    interface: str | None,
    device: str,
    timeout: float,
    as_json: bool,
) -> None:
    """Load each installed backend, or those called NAME, and report errors.

    "missing": the backend reports missing files or packages. "BROKEN": any other error; the exit
    code is then 5.
    """
    require_interface(interface)
    named = find_by_name(with_current_folder(name)) if name is not None else list_backends()
    offers = [offer for offer in named if interface in (None, offer.interface)]
    results = _with_bar(try_in_processes(offers, device, timeout), len(offers))
    place = {
        (offer.interface, offer.name, offer.owner): index for index, offer in enumerate(offers)
    }
    found = sorted(results, key=lambda one: place[one.interface, one.backend, one.owner])
    for broken in broken_plugins() if name is None else ():
        trace = traceback_text(broken.error)
        owner = f"{broken.distribution} {broken.version}".rstrip()
        found.append(DoctorResult("-", "-", owner, "broken", broken.cause, traceback=trace))
    if as_json:
        echo_json([asdict(finding) for finding in found])
    else:
        for finding in found:
            echo(str(finding))
        count = {
            state: sum(f.state == state for f in found) for state in ("ok", "missing", "broken")
        }
        echo(f"{len(found)} checked: {', '.join(f'{n} {state}' for state, n in count.items())}")
    ctx.exit(BACKEND if any(finding.state == "broken" for finding in found) else 0)


def try_backend(offer: Offer, device: str) -> DoctorResult:
    """Import, construct, load and close a backend with default options, and return the result."""
    start = time.perf_counter()
    step = "import"
    owner = offer.target.partition(":")[0]
    try:
        kind = load_class(offer)
        owner = kind.__module__
        step = "constructor"
        with plugin_code():
            backend = kind()
        step = "missing()"
        if messages := missing_requirements(backend):
            return _result(offer, "missing", "; ".join(messages))
        step = f"load('{device}')"
        with plugin_code():
            backend.load(device)
        step = "close()"
        with plugin_code():
            backend.close()
    except PhysicError as error:
        # A PhysicError of the backend itself is "missing"; a failed import or check is "broken".
        state: Literal["missing", "broken"] = (
            "broken" if step in ("import", "missing()") else "missing"
        )
        return _result(offer, state, str(error).removeprefix(str(offer)).lstrip(": "), error)
    except Exception as error:
        return _result(offer, "broken", f"{step} fails: {describe_error(error, owner)}", error)
    return replace(_result(offer, "ok"), seconds=round(time.perf_counter() - start, 2))


def try_in_processes(
    offers: Iterable[Offer], device: str, timeout: float
) -> Iterator[DoctorResult]:
    """Run :func:`try_backend` for each backend in a process of its own; yield the results in the
    order of their end.

    Args:
        offers: the backends.
        device: for ``load``. On a CPU, two backends are loaded at the same time.
        timeout: time limit of each, s.
    """
    waiting = deque(offers)
    trials = list[_Trial]()
    context = _context()
    at_once = _AT_ONCE if device == "cpu" else 1
    try:
        while waiting or trials:
            while waiting and len(trials) < at_once:
                trials.append(_Trial(waiting.popleft(), device, timeout, context))
            left = min(trial.deadline for trial in trials) - time.monotonic()
            connection.wait([trial.sentinel for trial in trials], max(0.0, left))
            for trial in [one for one in trials if one.is_over()]:
                trials.remove(trial)
                yield trial.end()
    finally:
        for trial in trials:
            trial.end()


def _with_bar(results: Iterable[DoctorResult], count: int) -> list[DoctorResult]:
    """Return the results; a terminal shows a bar meanwhile."""
    if not sys.stderr.isatty():
        return list(results)
    with click.progressbar(
        results, length=count, label="backends", show_pos=True, file=sys.stderr
    ) as bar:
        return list(bar)


def _context() -> Any:
    """Return how processes start: on Linux, as copies of one that has imported torch, which alone
    takes a second.
    """
    if sys.platform != "linux":
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__, "physic_testing.commands.common_imports"])
    return context


class _Trial:
    """One backend in a process of its own.

    Attributes:
        sentinel: becomes ready when the process has ended.
        deadline: end of the time limit, by the monotonic clock.
    """

    def __init__(self, offer: Offer, device: str, timeout: float, context: Any) -> None:
        self._offer = offer
        self._timeout = timeout
        # Files, not pipes: processes that the backend has started may keep a pipe open after the
        # time limit.
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self._process = context.Process(
            target=_main, args=(offer, device, self._folder.name, dict(os.environ))
        )
        with started_processes():
            self._process.start()
        self.sentinel = self._process.sentinel
        self.deadline = time.monotonic() + timeout

    def is_over(self) -> bool:
        """Return whether the process, or its time, has ended."""
        return not self._process.is_alive() or time.monotonic() >= self.deadline

    def end(self) -> DoctorResult:
        """Return what the process has found, and why it has not if there is nothing; it is
        ended.
        """
        is_late = self._process.is_alive()
        self._process.kill()
        self._process.join()
        with self._folder as folder:
            if is_late:
                return _result(self._offer, "broken", f"not finished after {self._timeout:g} s")
            with suppress(OSError, ValueError, TypeError, KeyError):
                found = json.loads(Path(folder, _ANSWER).read_bytes())
                values = {
                    key: found[key] for key in ("owner", "state", "message", "seconds", "traceback")
                }
                return replace(_result(self._offer, "ok"), **values)
            text = Path(folder, _OUTPUT).read_text(encoding="utf-8", errors="replace")
        last = (text.strip() or "no output").rpartition("\n")[2]
        result = _result(
            self._offer, "broken", f"it ended Python with code {self._process.exitcode}: {last}"
        )
        return replace(result, traceback=text) if is_debugging() else result


def _result(
    offer: Offer,
    state: Literal["ok", "missing", "broken"],
    message: str = "",
    error: BaseException | None = None,
) -> DoctorResult:
    return DoctorResult(
        offer.interface, offer.name, offer.owner, state, message, traceback=traceback_text(error)
    )


def _main(offer: Offer, device: str, folder: str, environment: Mapping[str, str]) -> None:
    """Write what :func:`try_backend` finds, and all that is printed, to files of a folder; runs in
    the process.
    """
    os.environ.clear()
    os.environ.update(environment)
    with Path(folder, _OUTPUT).open("wb") as output, open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), 0)
        os.dup2(output.fileno(), 1)
        os.dup2(output.fileno(), 2)
    sys.stdout, sys.stderr = os.fdopen(1, "w", buffering=1), os.fdopen(2, "w", buffering=1)
    found = try_backend(offer, device)
    Path(folder, _ANSWER).write_text(json.dumps(asdict(found)), encoding="utf-8")
    with suppress(OSError, ValueError):  # the backend has closed it
        sys.stdout.flush()
    os._exit(0)  # threads and exit handlers of the backend must not keep the process
