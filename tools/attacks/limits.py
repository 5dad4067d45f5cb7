"""Run ``physic run`` with ever less memory and ever smaller files: ``python tools/attacks/limits.py [--rungs 12]``.

A run must end with a complete result, or with a message and without a traceback; a result of an earlier run stays
complete. Native libraries end the process when they get no memory; this is counted, and the earlier result must stay.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image

from kill_runs import PHYSIC, RUN, fault_of
from physic_core.files.atomic import committed_path
from physic_testing.worlds import build_world

LADDERS = {"memory": (resource.RLIMIT_AS, 800 << 20, 2 << 30), "file size": (resource.RLIMIT_FSIZE, 0, 1 << 20)}
"""The limit, its lowest and its highest rung, bytes. The mock preset on a photo of 96 x 72 px succeeds at the highest.
With less memory than the lowest, native libraries cannot be loaded; OpenBLAS then tries for ever."""

NATIVE_ENDS = ("bad_alloc", "OpenBLAS", "terminate called", "libgomp", "Fatal Python error")


def run_limited(folder: Path, limit: int, size: int) -> tuple[int, str]:
    """Run the command with a limit of its process; return its exit code and what it printed."""
    environment = os.environ | {"PHYSIC_CACHE": "off", "OMP_NUM_THREADS": "1"}
    ended = subprocess.run(
        (*PHYSIC, *RUN),
        cwd=folder,
        env=environment,
        capture_output=True,
        preexec_fn=lambda: resource.setrlimit(limit, (size, size)),
        check=False,
        timeout=600,
    )
    return ended.returncode, (ended.stdout + ended.stderr).decode(errors="replace")


def outcome(folder: Path, code: int, text: str, had_result: bool) -> tuple[str, str]:
    """Return how a run ended ("done", "refused", "native") and what is wrong; "" for nothing."""
    out = folder / "out"
    kind = "done" if code == 0 else "refused"
    if code < 0 or (code and any(words in text for words in NATIVE_ENDS)):
        kind = "native"
    has_result = committed_path(out, "reconstruction.json").exists()
    if had_result and not has_result:
        return kind, "the earlier result is gone"
    if code == 0 and not has_result:
        return kind, "it ended with 0 and without a result"
    if has_result and (fault := fault_of(out)):
        return kind, fault
    if kind == "refused" and ("Traceback" in text or "Error" not in text):
        return kind, f"it ended with {code}: {text.strip()[-400:]}"
    return kind, ""


def main() -> int:
    """Climb down each ladder twice, without and with an earlier result; return 1 if a run did not end as it must."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rungs", type=int, default=12, help="of each ladder")
    parser.add_argument("--minutes", type=float, default=1e6, help="end after this time")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-findings/limits"))
    given = parser.parse_args()
    end, failed = time.monotonic() + 60 * given.minutes, 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        Image.fromarray(build_world("stand", size=(96, 72)).image).save(folder / "photo.png")
        for name, (limit, lowest, highest) in LADDERS.items():
            counts: dict[str, int] = {}
            for rung in range(given.rungs, -1, -1):
                if time.monotonic() > end:
                    break
                # On every second rung nothing is there before.
                if rung % 2:
                    shutil.rmtree(folder / "out", ignore_errors=True)
                had_result = (folder / "out" / "reconstruction.json").exists()
                size = lowest + (highest - lowest) * rung // given.rungs
                code, text = run_limited(folder, limit, size)
                kind, fault = outcome(folder, code, text, had_result)
                counts[kind] = counts.get(kind, 0) + 1
                if fault:
                    failed += 1
                    given.keep.mkdir(parents=True, exist_ok=True)
                    (given.keep / f"{name.replace(' ', '-')}-{size}.txt").write_text(f"{fault}\n\n{text}")
                    print(f"FAILED {name} {size:,} bytes: {fault}", flush=True)
                if not (folder / "out").exists() and rung % 2:
                    run_limited(folder, limit, resource.RLIM_INFINITY)
            print(f"{name}: {counts}", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
