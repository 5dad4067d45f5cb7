"""``physic plugins doctor``: load every installed backend, each in its own process.

A backend that crashes Python, hangs, or uses all memory does not affect the others.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Literal

import click

from physic_core.cli.arguments import class_here, require_interface
from physic_core.cli.exit_codes import BACKEND
from physic_core.discovery.error_text import debugging, describe, traceback_text

if TYPE_CHECKING:
    from physic_core.discovery.registry import Claim, Registry

__all__ = ["Finding", "doctor", "examine", "in_its_own_process"]

_MARK = "physic-doctor: "


@dataclass(frozen=True)
class Finding:
    """Result of loading one backend.

    Attributes:
        interface: "metric_depth", ...; "-" for a plugin whose backends could not be listed.
        backend: its name.
        owner: distribution and version.
        state: "ok"; "missing" if the backend itself reports missing files; "broken" for all other errors.
        message: what is missing or broken.
        seconds: time to import, construct, load and close it, s.
        traceback: of its exception if ``PHYSIC_DEBUG`` is set; else "".
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
        line = f"{self.state.upper() if self.state == 'broken' else self.state:<8} {self.title}: {end}"
        return "\n".join(filter(None, (line, self.traceback.rstrip("\n"))))

    @property
    def title(self) -> str:
        """Interface, name and owner of the backend."""
        return self.owner if self.backend == "-" else f"{self.interface} '{self.backend}' ({self.owner})"


@click.command()
@click.argument("name", required=False)
@click.option("--interface", metavar="NAME", help="Only backends of this interface.")
@click.option("--device", default="cpu", show_default=True, metavar="NAME", help="cpu, cuda or cuda:N.")
@click.option("--timeout", default=300.0, show_default=True, metavar="SECONDS", help="Time limit for each backend.")
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON.")
@click.pass_context
def doctor(
    ctx: click.Context, name: str | None, interface: str | None, device: str, timeout: float, as_json: bool
) -> None:
    """Load each installed backend, or those called NAME, and report what is missing or broken.

    "missing": the backend itself reports that something is missing, such as a file that you have to provide.
    "BROKEN": anything else; the command then exits with code 5.
    """
    from physic_core.discovery.plugins import discover

    require_interface(interface)
    registry = discover()
    claims = registry.called(class_here(name)) if name is not None else tuple(registry)
    claims = tuple(claim for claim in claims if interface in (None, claim.record.interface))
    found: list[Finding] = []
    for finding in findings(registry, claims, lambda claim: in_its_own_process(claim, device, timeout), name is None):
        found.append(finding)
        if not as_json:
            click.echo(str(finding))
    if as_json:
        click.echo(json.dumps([asdict(finding) for finding in found], indent=2))
    else:
        count = {state: sum(f.state == state for f in found) for state in ("ok", "missing", "broken")}
        click.echo(f"{len(found)} looked at: {', '.join(f'{n} {state}' for state, n in count.items())}")
    ctx.exit(BACKEND if any(finding.state == "broken" for finding in found) else 0)


def findings(
    registry: Registry, claims: Iterable[Claim], load: Callable[[Claim], Finding], whole: bool = True
) -> Iterable[Finding]:
    """Yield a finding for each backend, then for each plugin that is broken or not recognised.

    Args:
        registry: the installed plugins.
        claims: the backends to load.
        load: function that loads one backend.
        whole: whether to include broken plugins.
    """
    from physic_core.discovery.misplaced import misplaced

    for claim in claims:
        if claim.problem:
            yield _finding(claim, "broken", claim.problem)
        else:
            yield load(claim)
    for lost in registry.broken if whole else ():
        yield Finding("-", "-", str(lost.origin), "broken", lost.cause, traceback=traceback_text(lost.error))
    for near in misplaced() if whole else ():
        # A library may be called physic-... and offer nothing on purpose: that alone is no error.
        yield Finding("-", "-", str(near.origin), "broken" if near.group else "missing", near.cause)


def examine(registry: Registry, claim: Claim, device: str) -> Finding:
    """Import, construct, load and close a backend with default options, in this process."""
    from physic_core.discovery.readiness import missing_requirements
    from physic_core.errors import PhysicError

    start = time.perf_counter()
    step, owner = "import", claim.origin.plugin
    try:
        kind = registry.load_concrete_class(claim)
        owner = kind.__module__
        step = "constructor"
        backend = kind()
        step = "missing()"
        if lacking := missing_requirements(backend):
            return _finding(claim, "missing", "; ".join(lacking))
        step = f"load('{device}')"
        backend.load(device)
        step = "close()"
        backend.close()
    except PhysicError as error:
        # "missing" is only what the backend itself reports; a failed import or call is "broken".
        state: Literal["missing", "broken"] = "broken" if step in ("import", "missing()") else "missing"
        return _finding(claim, state, str(error).removeprefix(str(claim)).lstrip(": "), error)
    except (Exception, SystemExit) as error:
        return _finding(claim, "broken", f"{step} fails: {describe(error, owner)}", error)
    return replace(_finding(claim, "ok"), seconds=round(time.perf_counter() - start, 2))


def in_its_own_process(claim: Claim, device: str, timeout: float) -> Finding:
    """Run :func:`examine` in a new process with the same import path."""
    record = claim.record
    look = f"import sys; from {__name__} import _main; _main(*sys.argv[1:])"
    # A name with a colon is that of a class.
    name = str(record.target) if ":" in record.name else f"{claim.origin.distribution}:{record.name}"
    command = [sys.executable, "-P", "-c", look, record.interface, name, device]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    try:
        done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=timeout, check=False)
    except subprocess.TimeoutExpired:
        return _finding(claim, "broken", f"not done after {timeout:g} s")
    for line in done.stdout.splitlines():
        if line.startswith(_MARK):
            return Finding(**json.loads(line.removeprefix(_MARK)))
    last = (done.stderr.strip() or "no word").rpartition("\n")[2]
    ended = _finding(claim, "broken", f"it ended Python with code {done.returncode}: {last}")
    return replace(ended, traceback=done.stderr) if debugging() else ended


def _finding(
    claim: Claim, state: Literal["ok", "missing", "broken"], message: str = "", error: BaseException | None = None
) -> Finding:
    record = claim.record
    owner, trace = str(claim.origin), traceback_text(error)
    return Finding(record.interface, record.name, owner, state, message, traceback=trace)


def _main(interface: str, name: str, device: str) -> None:
    from physic_core.discovery.plugins import discover

    registry = discover()
    claim = registry.get(interface, name)
    click.echo(f"\n{_MARK}{json.dumps(asdict(examine(registry, claim, device)))}")
