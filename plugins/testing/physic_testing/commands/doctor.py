"""The command ``physic plugins doctor``: load every installed backend, each in a separate process.

A backend that crashes, hangs, or uses all memory does not affect the others.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import click

from physic_core.cli.arguments import Number, require_interface, with_current_folder
from physic_core.cli.exit_codes import BACKEND
from physic_core.cli.output import echo, echo_json
from physic_core.discovery.backends import (
    find_by_name,
    list_backends,
    load_class,
    missing_requirements,
)
from physic_core.discovery.entry_points import Offer
from physic_core.discovery.error_text import describe_error, is_debugging, traceback_text
from physic_core.discovery.plugin_code import plugin_code
from physic_core.discovery.plugins import broken_plugins
from physic_core.errors import PhysicError
from physic_testing.commands.conformance import DEVICE

_AT_ONCE = 2
"""Backends that are loaded at the same time; more could take more memory than the machine has."""


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
@DEVICE
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
    findings = _with_bar(try_in_processes(offers, device, timeout), len(offers))
    for broken in broken_plugins() if name is None else ():
        trace = traceback_text(broken.error)
        owner = f"{broken.distribution} {broken.version}".rstrip()
        findings.append(DoctorResult("-", "-", owner, "broken", broken.cause, traceback=trace))
    if as_json:
        echo_json([asdict(finding) for finding in findings])
    else:
        for finding in findings:
            echo(str(finding))
        count = {
            state: sum(f.state == state for f in findings) for state in ("ok", "missing", "broken")
        }
        echo(f"{len(findings)} checked: {', '.join(f'{n} {state}' for state, n in count.items())}")
    ctx.exit(BACKEND if any(finding.state == "broken" for finding in findings) else 0)


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
            return _doctor_result(offer, "missing", "; ".join(messages))
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
        return _doctor_result(offer, state, str(error).removeprefix(str(offer)).lstrip(": "), error)
    except Exception as error:
        return _doctor_result(
            offer, "broken", f"{step} fails: {describe_error(error, owner)}", error
        )
    return replace(_doctor_result(offer, "ok"), seconds=round(time.perf_counter() - start, 2))


def try_in_processes(
    offers: Iterable[Offer], device: str, timeout: float
) -> Iterator[DoctorResult]:
    """Run :func:`try_backend` for each backend in a process of its own; yield the results.

    Args:
        offers: the backends.
        device: for ``load``. On a CPU, two backends are loaded at the same time.
        timeout: time limit of each, s.
    """
    with ThreadPoolExecutor(_AT_ONCE if device == "cpu" else 1) as pool:
        yield from pool.map(lambda offer: _try_in_process(offer, device, timeout), offers)


def _try_in_process(offer: Offer, device: str, timeout: float) -> DoctorResult:
    # Files, not pipes, which processes that the backend starts could keep open.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        answer = Path(folder, "answer.json")
        output = Path(folder, "output.txt")
        arguments = ["-P", "-m", __spec__.name, json.dumps(asdict(offer)), device, str(answer)]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        with output.open("wb") as stream:
            try:
                done = subprocess.run(
                    [sys.executable, *arguments],
                    env=environment,
                    stdin=subprocess.DEVNULL,
                    stdout=stream,
                    stderr=subprocess.STDOUT,
                    timeout=timeout,
                    check=False,
                )
            except subprocess.TimeoutExpired:
                return _doctor_result(offer, "broken", f"not finished after {timeout:g} s")
        with suppress(OSError, ValueError, TypeError):
            return DoctorResult(**json.loads(answer.read_bytes()))
        text = output.read_text(encoding="utf-8", errors="replace")
    last = (text.strip() or "no output").rpartition("\n")[2]
    cause = f"it ended Python with code {done.returncode}: {last}"
    return replace(_doctor_result(offer, "broken", cause), traceback=text if is_debugging() else "")


def _with_bar(results: Iterable[DoctorResult], count: int) -> list[DoctorResult]:
    """Return the results; a terminal shows a bar meanwhile."""
    if not sys.stderr.isatty():
        return list(results)
    with click.progressbar(
        results, length=count, label="backends", show_pos=True, file=sys.stderr
    ) as bar:
        return list(bar)


def _doctor_result(
    offer: Offer,
    state: Literal["ok", "missing", "broken"],
    message: str = "",
    error: BaseException | None = None,
) -> DoctorResult:
    return DoctorResult(
        offer.interface, offer.name, offer.owner, state, message, traceback=traceback_text(error)
    )


if __name__ == "__main__":
    offered, chosen_device, answer_path = sys.argv[1:]
    found = try_backend(Offer(**json.loads(offered)), chosen_device)
    Path(answer_path).write_text(json.dumps(asdict(found)), encoding="utf-8")
    with suppress(OSError, ValueError):  # the backend has closed it
        sys.stdout.flush()
    os._exit(0)  # threads and exit handlers of the backend must not keep the process
