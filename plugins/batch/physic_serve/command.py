"""The command ``physic serve``: a page in the browser that reconstructs photos, until a signal ends
it.
"""

from __future__ import annotations

import signal
import socket
import sys
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

import click

from physic_core.cli.arguments import AnyPath, WholeNumber, configuration_options
from physic_core.cli.exit_codes import INTERRUPTED
from physic_core.cli.output import echo
from physic_core.errors import ConfigError

_LOCAL = ("localhost", "127.0.0.1", "[::1]")
# About 2 s of a core and 10 MB for two people; not ply (46 MB) or obj.
_EXPORTS = ("glb", "bvh", "usd", "mjcf")


@click.command()
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option(
    "--port",
    default=8000,
    show_default=True,
    type=WholeNumber(0, 65535),
    help="0 chooses a free one.",
)
@configuration_options
@click.option(
    "--allow-host", metavar="NAME", multiple=True, help="A name or address of this server."
)
@click.option(
    "--export",
    "exports",
    metavar="FORMAT",
    multiple=True,
    help=f"Format of physic export to write beside each result; may be repeated.  [default: "
    f"{', '.join(_EXPORTS)}]",
)
@click.option(
    "--folder",
    type=AnyPath(),
    help="Folder for the results while the server runs.  [default: the temporary folder]",
)
def serve(
    host: str,
    port: int,
    file: Path | None,
    preset: str | None,
    overrides: tuple[str, ...],
    allow_host: tuple[str, ...],
    exports: tuple[str, ...],
    folder: Path | None,
) -> None:
    """Serve a page on this computer that reconstructs uploaded photos, one at a time.

    The server deletes all results when it ends.
    """
    import uvicorn

    from physic_core import load_config
    from physic_core.files import check_writable
    from physic_core.pictures import require_pictures
    from physic_serve.app import make_app
    from physic_serve.jobs import Jobs
    from physic_serve.worker import Worker

    config = load_config(file, preset=preset, overrides=overrides)
    require_pictures()
    formats = _checked_formats(exports)
    parent = check_writable(folder or tempfile.gettempdir())
    _end_at_signals()
    address = f"[{host}]" if ":" in host else host
    listening = _listen(host, port)  # before the models are loaded, which takes long
    temporary = tempfile.TemporaryDirectory(
        prefix="metricbody-batch-", dir=parent, ignore_cleanup_errors=True
    )
    with _saying_end(), closing(listening), temporary as place:
        tempfile.tempdir = place  # for parts of forms
        echo("loading the models", err=True)
        with closing(Jobs(Path(place), partial(Worker, config, formats))) as jobs:
            if address not in _LOCAL:
                echo(
                    f"warning: anyone who reaches {host} can use this server: it has no password",
                    err=True,
                )
            app = make_app(jobs, (*_LOCAL, address, *allow_host), example_photos())
            settings = uvicorn.Config(
                app,
                host,
                port,
                ws="none",
                lifespan="off",
                log_level="warning",
                timeout_graceful_shutdown=2,
            )
            echo(f"http://{address}:{listening.getsockname()[1]}/  (Ctrl-C ends it)")
            uvicorn.Server(settings).run([listening])


@contextmanager
def _saying_end() -> Iterator[None]:
    """Say after Ctrl-C that nothing is left to continue with."""
    try:
        yield
    except KeyboardInterrupt:
        echo("the server has ended, and its results are deleted", err=True)
        sys.exit(INTERRUPTED)


def _listen(host: str, port: int) -> socket.socket:
    """Return a socket that listens at an address.

    Raises:
        ConfigError: the host is unknown, or the port is in use or not allowed.
    """
    try:
        family, _, _, _, place = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except socket.gaierror as error:
        raise ConfigError(
            f"--host {host} is not an address of this computer: {error.strerror}; give an address "
            "or a name alone, such as 127.0.0.1, and the port with --port"
        ) from error
    made = socket.socket(family, socket.SOCK_STREAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(place)
        made.listen()
    except OSError as error:
        made.close()
        raise ConfigError(
            f"cannot listen at --host {host} --port {port}: {error.strerror}; give a --host of "
            "this computer, such as 127.0.0.1, and a --port that is free: 0 takes any"
        ) from error
    return made


def example_photos() -> dict[str, Path]:
    """Return the photos in the folder ``examples`` of a checkout by name; wheels of PhySIC have
    none.
    """
    import physic_core

    folder = Path(physic_core.__file__).parents[1] / "examples"
    return {path.name: path for path in sorted(folder.glob("*.jpg"))}


def _checked_formats(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the formats to export: those named, or those of the default that are installed with
    their libraries.
    """
    from physic_core import find_exporter, find_exporters

    if names:
        return tuple(dict.fromkeys(find_exporter(name).record.name for name in names))
    installed = {each.record.name for each in find_exporters() if not each.record.missing_packages}
    return tuple(name for name in _EXPORTS if name in installed)


def _end_at_signals() -> None:
    """Let SIGTERM end the server as Ctrl-C does, and SIGHUP as SIGTERM, also while uvicorn handles
    SIGTERM.
    """
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    # as nohup sets it
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        signal.signal(signal.SIGHUP, lambda *_: signal.raise_signal(signal.SIGTERM))
