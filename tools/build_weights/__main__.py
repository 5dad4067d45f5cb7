"""Make the networks of physic-embedded again and compare them with those that ship.

    python -m tools.build_weights [NETWORK ...] --out FOLDER

Needs npm on the path, and onnx, ai-edge-litert, torch and setuptools in Python. The files that ship
were made with the versions that MANIFEST.json states; other versions of onnx or torch may write
other bytes for the same network.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from tools.build_weights.packages import Cache, sha256
from tools.build_weights.recipes import RECIPES

SHIPPED = Path(__file__).parents[2] / "plugins" / "physic-embedded" / "physic_embedded" / "weights"


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("networks", nargs="*", choices=[*RECIPES, []], help="default: all")
    parser.add_argument(
        "--out", type=Path, required=True, help="folder for the ONNX files and, in it, the packages"
    )
    args = parser.parse_args()
    manifest = json.loads((SHIPPED / "MANIFEST.json").read_text())
    expected = {
        entry["file"]: entry["sha256"]
        for entry in (*manifest["models"], *manifest.get("weights", []))
    }
    cache = Cache(args.out / "packages")
    different = 0
    for name in args.networks or RECIPES:
        made = RECIPES[name](cache)
        for file, data in (made if isinstance(made, dict) else {f"{name}.onnx": made}).items():
            (args.out / file).write_bytes(data)
            same = sha256(data) == expected.get(file)
            different += not same
            print(
                f"{file}: {len(data)} bytes, "
                f"{'as shipped' if same else 'other bytes than shipped'}",
                flush=True,
            )
    return 1 if different else 0


if __name__ == "__main__":
    raise SystemExit(main())
