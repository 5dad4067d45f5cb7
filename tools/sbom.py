"""Write a software bill of materials of this environment (CycloneDX 1.6, JSON).

    python tools/sbom.py [FILE]

It lists the distributions of PhySIC, everything that they require, with versions and licenses as
installed, and the networks and the body that ship in the wheels, with their SHA-256 and licenses.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
OWN = [
    "metricbody",
    *sorted(f"metricbody-{path.parent.name}" for path in ROOT.glob("plugins/*/pyproject.toml")),
]
WEIGHTS = ROOT / "plugins/embedded/physic_embedded/weights"
BODY = ROOT / "physic_core/body/embedded.sha256"

Component = dict[str, Any]


def bill() -> dict[str, Any]:
    """Return the bill of materials as a document of CycloneDX."""
    distributions = {name: distribution(name) for name in OWN}
    rest = list(distributions.values())
    required: dict[str, list[str]] = {}
    while rest:
        of = rest.pop()
        names = required[canonicalize_name(of.name)] = []
        for name in requirements(of):
            try:
                other = distributions.get(name) or distribution(name)
            except PackageNotFoundError:  # an optional package of an installed extra
                continue
            names.append(name)
            if name not in distributions:
                distributions[name] = other
                rest.append(other)
    packages = [package(distributions[name]) for name in sorted(distributions)]
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "name": "PhySIC",
                "version": distributions["metricbody"].version,
            }
        },
        "components": [*packages, *networks(), body()],
        "dependencies": [
            {
                "ref": reference(distributions[name]),
                "dependsOn": sorted({reference(distributions[other]) for other in required[name]}),
            }
            for name in sorted(distributions)
        ],
    }


def requirements(of: Distribution) -> Iterator[str]:
    """Yield the names of what a distribution requires here, without extras."""
    for line in of.requires or ():
        requirement = Requirement(line)
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            yield canonicalize_name(requirement.name)


def reference(of: Distribution) -> str:
    return f"pkg:pypi/{canonicalize_name(of.name)}@{of.version.replace('+', '%2B')}"


def package(of: Distribution) -> Component:
    address = reference(of)
    component: Component = {
        "type": "library",
        "bom-ref": address,
        "name": canonicalize_name(of.name),
        "version": of.version,
        "purl": address,
    }
    if text := licence(of):
        component["licenses"] = [{"license": {"name": text}}]
    return component


def licence(of: Distribution) -> str:
    """Return the licence that a distribution states: as an expression, in a classifier, or in a
    line of text.
    """
    stated: list[str] = [of.metadata.get("License-Expression", "")]
    stated += [
        c.rpartition(" :: ")[2]
        for c in of.metadata.get_all("Classifier", [])
        if c.startswith("License ::")
    ]
    stated.append(of.metadata.get("License", "").strip().partition("\n")[0])
    return next((text for text in stated if text and text != "UNKNOWN"), "")


def networks() -> list[Component]:
    manifest = json.loads((WEIGHTS / "MANIFEST.json").read_text(encoding="utf-8"))
    return [
        data(
            f"physic_embedded/weights/{file['file']}",
            file["sha256"],
            re.split("[: (]", file["weights_license"])[0],
        )
        for file in (*manifest["models"], *manifest["weights"])
    ]


def body() -> Component:
    digest, name = BODY.read_text(encoding="utf-8").split()
    return data(f"physic_core/body/{name}", digest, "Apache-2.0")


def data(path: str, digest: str, licence: str) -> Component:
    return {
        "type": "machine-learning-model" if path.endswith(".onnx") else "data",
        "bom-ref": path,
        "name": path,
        "hashes": [{"alg": "SHA-256", "content": digest}],
        "licenses": [{"license": {"id": licence}}],
    }


def main() -> int:
    """Write the bill of materials to a file, or print it."""
    text = json.dumps(bill(), indent=1) + "\n"
    if len(sys.argv) > 1:
        file = Path(sys.argv[1])
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    else:
        print(text, end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
