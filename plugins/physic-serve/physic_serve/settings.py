"""Limits of the server."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """What the server accepts and keeps.

    Attributes:
        queue: largest number of photos that wait; one more can be reconstructed or sent.
        upload_mb: largest upload, MB of 10^6 bytes.
        upload_s: longest time of one upload, s.
        head_s: longest time until the head of a request is complete, s. A head is under 64 kB; 15 s allow 4 kB/s. An
            upload and a response may fall behind the least rate by this time.
        rate_bytes_s: least rate at which a client has to send a photo and to read a response, byte/s.
        connections: largest number of connections. For a new one, the client with the most loses its longest idle one.
        job_s: longest time of one reconstruction, s.
        results: largest number of finished reconstructions that are kept; the oldest is deleted first.
        result_s: age at which a finished reconstruction is deleted, s.
    """

    queue: int = 8
    upload_mb: float = 40.0
    upload_s: float = 120.0
    head_s: float = 15.0
    rate_bytes_s: float = 20_000.0
    connections: int = 100
    job_s: float = 600.0
    results: int = 50
    result_s: float = 24 * 3600.0
