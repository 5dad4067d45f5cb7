"""The command ``physic serve``."""

from __future__ import annotations

import ipaddress
import signal
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import click

from physic_core import BackendError

__all__ = ["exposure_warning", "is_loopback", "serve"]


class _PositiveNumber(click.FloatRange):
    def __init__(self) -> None:
        super().__init__(min=0, max=10_000_000, min_open=True)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        number: float = super().convert(value, param, ctx)
        if number != number:  # which is in every range of click
            self.fail("nan is not a number", param, ctx)
        return number


_POSITIVE = _PositiveNumber()


@click.command()
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--port", default=8000, show_default=True, type=click.IntRange(0, 65535), help="0 chooses a free one.")
@click.option("--config", "file", metavar="FILE", type=click.Path(path_type=Path), help="A TOML file.")
@click.option("--preset", metavar="NAME", help="Preset to build on.  [default: embedded]")
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help="Change one value; may be repeated.")
@click.option("--queue", default=8, show_default=True, type=click.IntRange(1), help="Most photos that wait.")
@click.option("--max-mb", default=40.0, show_default=True, type=_POSITIVE, help="Largest upload, MB.")
@click.option("--timeout", default=600.0, show_default=True, type=_POSITIVE, help="Longest time of one photo, s.")
@click.option("--keep", default=50, show_default=True, type=click.IntRange(1), help="Most results that are kept.")
@click.option("--keep-hours", default=24.0, show_default=True, type=_POSITIVE, help="Age at which one is deleted.")
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
    folder: Path | None,
) -> None:
    """Serve a page where photos are uploaded and reconstructed, and the same as an HTTP interface.

    Photos are reconstructed one at a time. All uploads and results are deleted when the server ends.
    """
    import uvicorn

    from physic_core import load_config
    from physic_serve.app import make_app
    from physic_serve.jobs import Jobs
    from physic_serve.settings import Limits
    from physic_serve.worker import Worker

    config = load_config(file, preset=preset, overrides=overrides)
    limits = Limits(queue=queue, upload_mb=max_mb, job_s=timeout, results=keep, result_s=keep_hours * 3600)
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    place = Path(tempfile.mkdtemp(prefix="physic-serve-", dir=folder))
    jobs = Jobs(place, partial(Worker, config), limits)
    signal.signal(signal.SIGTERM, _end)
    jobs.start()
    try:
        click.echo("loading the models", err=True)
        if refused := jobs.wait_until_open():
            raise BackendError(refused)
        loopback = is_loopback(host)
        if not loopback:
            click.echo(exposure_warning(host), err=True)
        app = make_app(jobs, frozenset({"localhost", "127.0.0.1", "::1", host}) if loopback else None)
        server = uvicorn.Server(
            uvicorn.Config(app, host, port, log_level="warning", limit_concurrency=100, timeout_graceful_shutdown=2)
        )
        server.config.load()
        sockets = [server.config.bind_socket()]
        address = f"[{host}]" if ":" in host else host
        click.echo(f"http://{address}:{sockets[0].getsockname()[1]}/  (Ctrl-C ends it)")
        server.run(sockets)
    finally:
        jobs.close()


def _end(*_: object) -> None:
    """End as after Ctrl-C: the worker is ended and the results are deleted."""
    sys.exit(0)


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
