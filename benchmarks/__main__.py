"""Run one of the benchmarks: ``python -m benchmarks [NAME ...]``; without a name, list them."""

from __future__ import annotations

import sys
from importlib import import_module

BENCHMARKS = {
    "truth": "benchmarks.truth.command",
    "contact_on_photos": "benchmarks.contact_on_photos",
    "trust_on_photos": "benchmarks.trust_on_photos",
    "contradictions": "benchmarks.contradictions",
    "observer": "benchmarks.observer.command",
    "up": "benchmarks.up",
    "lifter": "benchmarks.lifter",
    "joint_errors": "benchmarks.joint_errors",
    "blazepose": "benchmarks.blazepose",
    "given_bodies": "benchmarks.given_bodies",
    "exports_opened": "benchmarks.exports_opened",
    "run_cost": "benchmarks.run_cost",
    "figures": "benchmarks.figures",
}
"""Name -> module, whose ``main`` reads the command line."""


def main() -> int | str:
    """Run the benchmark that the command line names."""
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name in BENCHMARKS:
        del sys.argv[1]
        return int(import_module(BENCHMARKS[name]).main() or 0)
    for benchmark, module in BENCHMARKS.items():
        print(f"{benchmark:18} {(import_module(module).__doc__ or '').partition(chr(10))[0]}")
    return 0 if name in ("", "-h", "--help") else f"there is no benchmark {name}"


if __name__ == "__main__":
    sys.exit(main())
