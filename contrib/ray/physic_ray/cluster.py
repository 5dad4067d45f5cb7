"""Connect to a Ray cluster, or start one on this machine that only this machine can reach."""

from __future__ import annotations

import logging
import os
import secrets
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from typing import Any

from physic_batch.workers import usable_cores
from physic_core.errors import ConfigError

_STORE_BYTES = 200_000_000  # rows are small; Ray's default takes 30 % of the memory
_CONNECT_S = 10.0
_QUIET = {"RAY_BACKEND_LOG_LEVEL": "fatal"}
# On Linux too, the ports of a cluster then are those of 127.0.0.1. Ray reads it when it is
# imported.
_LOOPBACK = {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0"}


@contextmanager
def connected(address: str | None) -> Iterator[bool]:
    """Connect this process to a cluster, and disconnect at the end; yield whether it was started
    here.

    A connection that this process already has is used and kept.

    Args:
        address: of the cluster, "auto" or "HOST:6379"; this machine is one of its nodes. None for
            that of the environment variable RAY_ADDRESS, or, without it, for a cluster that is
            started here and ended with this process. It reports no usage statistics, has no
            dashboard, listens on 127.0.0.1 only, and asks for a token that is in no file.

    Raises:
        ConfigError: the cluster cannot be reached, or has another version of Ray or Python.
    """
    address = address or os.environ.get("RAY_ADDRESS")
    started = address is None
    settings = _QUIET | _LOOPBACK | _token_of_this_process() if started else _QUIET
    for name, value in settings.items():
        os.environ.setdefault(name, value)
    import ray

    if ray.is_initialized():
        yield False
        return
    if address is not None:
        _check_reachable(address)
    local_settings: dict[str, Any] = {
        "num_cpus": usable_cores(),
        "object_store_memory": _STORE_BYTES,
        "include_dashboard": False,
    }
    # Ray reports lost nodes on stdout, which belongs to the results of a command.
    with _kept_signal_handler(), redirect_stdout(sys.stderr):
        try:
            with _silenced_native_code():
                ray.init(
                    address=address or "local",
                    log_to_driver=False,
                    logging_level=logging.ERROR,
                    **(local_settings if started else {}),
                )
        except Exception as error:  # Ray raises plain ones, too, as for a start of over 30 s
            where = (
                f"reach the Ray cluster at {address}" if address else "start Ray on this machine"
            )
            raise ConfigError(f"cannot {where}: {' '.join(str(error).split())}") from error
        try:
            yield started
        finally:
            ray.shutdown()


def _token_of_this_process() -> dict[str, str]:
    """Return variables of a cluster that only this process and its workers can use.

    Ray itself would write a token into the home folder.
    """
    return {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}


def _check_reachable(address: str) -> None:
    """Raise ConfigError if nothing listens at HOST:PORT; Ray itself would try for many minutes."""
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if host and port.isdigit():
        try:
            socket.create_connection((host.strip("[]"), int(port)), _CONNECT_S).close()
        except OSError as error:
            raise ConfigError(
                f"cannot reach the Ray cluster at {address}: {error.strerror or error}"
            ) from error


@contextmanager
def _silenced_native_code() -> Iterator[None]:
    """Hide what native code prints, such as the line that confirms RAY_BACKEND_LOG_LEVEL."""
    kept = os.dup(2)
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


@contextmanager
def _kept_signal_handler() -> Iterator[None]:
    """Keep the handler of SIGTERM, which ``ray.init`` replaces."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
