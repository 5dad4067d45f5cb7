"""Limits of the server."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """What the server accepts and keeps.

    Attributes:
        queue: largest number of photos that wait; one more can be reconstructed or sent.
        upload_mb: largest upload, MB of 10^6 bytes.
        job_s: longest time of one reconstruction, s.
        results: largest number of finished reconstructions that are kept; the oldest is deleted first.
        result_s: age at which a finished reconstruction is deleted, s.
    """

    queue: int = 8
    upload_mb: float = 40.0
    job_s: float = 600.0
    results: int = 50
    result_s: float = 24 * 3600.0
