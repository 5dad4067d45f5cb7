"""The command ``physic serve``: start the server that reconstructs uploaded photos, and end it at a signal."""

from __future__ import annotations

import ipaddress
import signal
import sys
import tempfile
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import click

from physic_core import BackendError, ConfigError
from physic_core.cli.arguments import configuration_options
from physic_core.cli.output import echo


class _PositiveNumber(click.FloatRange):
    def __init__(self) -> None:
        super().__init__(min=0, max=10_000_000, min_open=True)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        number: float = super().convert(value, param, ctx)
        if number != number:  # which is in every range of click
            self.fail("nan is not a number", param, ctx)
        return number


_POSITIVE = _PositiveNumber()
_EXPORTS = ("glb", "bvh", "usd", "mjcf")  # about 2 s of one core and 10 MB for two people; not ply (46 MB) and obj


@click.command()
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--port", default=8000, show_default=True, type=click.IntRange(0, 65535), help="0 chooses a free one.")
@configuration_options
@click.option("--queue", default=8, show_default=True, type=click.IntRange(1), help="Most photos that wait.")
@click.option("--max-mb", default=40.0, show_default=True, type=_POSITIVE, help="Largest upload, MB.")
@click.option("--timeout", default=600.0, show_default=True, type=_POSITIVE, help="Longest time of one photo, s.")
@click.option("--keep", default=50, show_default=True, type=click.IntRange(1), help="Most results that are kept.")
@click.option("--keep-hours", default=24.0, show_default=True, type=_POSITIVE, help="Age at which one is deleted.")
@click.option("--allow-host", metavar="NAME", multiple=True, help="A name of this server; may be repeated.")
@click.option(
    "--export",
    "exports",
    metavar="FORMAT",
    multiple=True,
    help=f"Format of physic export to write beside each result; may be repeated.  [default: {', '.join(_EXPORTS)}]",
)
@click.option("--folder", type=click.Path(path_type=Path), help="Where results lie.  [default: the temporary folder]")
def serve(
    host: str,
    port: int,
    file: Path | None,
    preset: str | None,
    overrides: tuple[str, ...],
    queue: int,
    max_mb: float,
    timeout: float,
    keep: int,
    keep_hours: float,
    allow_host: tuple[str, ...],
    exports: tuple[str, ...],
    folder: Path | None,
) -> None:
    """Serve a page where photos are uploaded and reconstructed, and the same as an HTTP interface.

    Photos are reconstructed one at a time. All uploads and results are deleted when the server ends.
    """
    import uvicorn

    from physic_core import load_config
    from physic_core.files.atomic import check_writable
    from physic_core.visual.report import require_report
    from physic_serve.app import make_app
    from physic_serve.jobs import Jobs
    from physic_serve.settings import Limits
    from physic_serve.worker import Worker, open_pipeline

    config = load_config(file, preset=preset, overrides=overrides)
    limits = Limits(queue=queue, upload_mb=max_mb, job_s=timeout, results=keep, result_s=keep_hours * 3600)
    formats = _formats(exports)
    try:
        require_report()
    except ConfigError as error:
        echo(f"results are shown without their page: {error}", err=True)
    parent = check_writable(folder or tempfile.gettempdir())
    _end_at_signals()
    with ExitStack() as stack:
        own = tempfile.TemporaryDirectory(prefix="physic-serve-", dir=parent, ignore_cleanup_errors=True)
        tempfile.tempdir = stack.enter_context(own)  # for parts of forms
        jobs = Jobs(Path(tempfile.tempdir), partial(Worker, config, open_pipeline, formats), limits)
        stack.callback(jobs.close)
        stack.callback(_ignore_signals)
        jobs.start()
        echo("loading the models", err=True)
        if refused := jobs.wait_until_open():
            raise BackendError(refused)
        if not is_loopback(host):
            echo(exposure_warning(host), err=True)
        names = {name.lower() for name in ("localhost", host, *allow_host)}
        app = make_app(jobs, frozenset(names))
        server = uvicorn.Server(
            uvicorn.Config(app, host, port, ws="none", log_level="warning", timeout_graceful_shutdown=2)
        )
        sockets = [server.config.bind_socket()]
        sockets[0].listen()  # clients may connect as soon as they read the address
        address = f"[{host}]" if ":" in host else host
        echo(f"http://{address}:{sockets[0].getsockname()[1]}/  (Ctrl-C ends it)")
        server.run(sockets)


def _formats(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the formats to export: those named, or those of the default that are installed with their libraries."""
    from physic_core import find_exporter, find_exporters

    if names:
        return tuple(dict.fromkeys(find_exporter(name).record.name for name in names))
    installed = {each.record.name for each in find_exporters() if not each.record.missing_packages}
    return tuple(name for name in _EXPORTS if name in installed)


def _end_at_signals() -> None:
    """Let SIGTERM end the server as Ctrl-C does, and SIGHUP as SIGTERM, also while uvicorn handles SIGTERM."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # as nohup sets it
        signal.signal(signal.SIGHUP, lambda *_: signal.raise_signal(signal.SIGTERM))


def _ignore_signals() -> None:
    """Let no second signal interrupt the deletion of uploads and results."""
    for name in {"SIGTERM", "SIGINT", "SIGHUP"} & set(dir(signal)):  # Windows has no SIGHUP
        signal.signal(getattr(signal, name), signal.SIG_IGN)


def exposure_warning(host: str) -> str:
    """Return what to consider before other machines can reach the server."""
    return (
        f"Warning: {host} can be reached by other machines. There is no password and no encryption: put a server in "
        "front that has both, or use the default 127.0.0.1."
    )


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach an address or name."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
