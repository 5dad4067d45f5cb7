"""The parts of pages that code, pictures or measurements state.

    python tools/pages.py            # write them
    python tools/pages.py --check    # name the pages that state anything else

A part stands below its mark, ``<!-- tools/pages.py: NAME -->``, and ends at the next blank line.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
import sys
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import docs_numbers

from physic_core import Person, Reconstruction, Scene, find_exporters, interfaces
from physic_core.cli.exit_codes import MEANINGS
from physic_core.discovery.backends import list_backends, load_class
from physic_core.discovery.entry_points import Offer
from physic_core.judge import CHECKS, CheckSpec
from physic_core.judge.trust import ALL
from physic_core.types import BodyParameters
from physic_core.types.tables import PERSON_COLUMNS
from physic_core.weights.library import licence_text, named_sets

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / "docs" / "figures.json"
"""What ``python -m benchmarks figures`` and ``run_cost`` measured."""
MARKS = ("place", "size", "contact", "pose")
"""The marks of people, the most often right ones first."""
FEW = 10
"""Of fewer people no share is stated."""

_PART = re.compile(r"^(<!-- tools/pages\.py: ([\w-]+) -->\n)((?:.+\n)*)", re.M)


def figures() -> dict[str, Any]:
    """Return the public figures."""
    read: dict[str, Any] = json.loads(FIGURES.read_text(encoding="utf-8"))
    return read


def table(names: Iterable[str], rows: Iterable[Iterable[str]], numbers: int = 0) -> str:
    """Return a table, its last columns aligned as numbers."""
    names = list(names)
    rule = "|" + "---|" * (len(names) - numbers) + "---:|" * numbers
    head, *lines = (f"| {' | '.join(cells)} |" for cells in (names, *rows))
    return "\n".join((head, rule, *lines))


def percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def with_interval(text: str) -> str:
    """Return a share with its interval, "0.743 (0.668 to 0.812)", in percent."""
    value, low, high = (100 * float(number) for number in re.findall(r"[\d.]+|nan", text))
    return "-" if value != value else f"{value:.0f} % ({low:.0f} to {high:.0f})"


def marks_table() -> str:
    trust = figures()["trust"]
    return table(
        ("mark", "people", "right", "usable", "right if usable", "right if doubtful"),
        (
            (
                mark,
                str(trust["right"][mark]["people"]),
                percent(trust["right"][mark]["share"]),
                percent(float(trust["scores"][mark]["share usable"].split()[0])),
                with_interval(trust["scores"][mark]["usable and right"]),
                with_interval(trust["scores"][mark]["doubtful and right"])
                if trust["scores"][mark]["share usable"] < "0.95"
                else "-",
            )
            for mark in MARKS
        ),
        5,
    )


def marks_line() -> str:
    trust = figures()["trust"]
    words = (
        f"{mark} for {percent(trust['right'][mark]['share'])} "
        f"({with_interval(trust['scores'][mark]['usable and right']).partition(' (')[0]} if usable)"
        for mark in MARKS
    )
    return (
        f"By the judgment of {trust['read by']} on {trust['people']} people in {trust['photos']} "
        f"photos (contact: {trust['right']['contact']['people']} people), these are right: "
        f"{', '.join(words)}."
    )


def all_marks_line() -> str:
    trust = figures()["trust"]
    right, scores = trust["right"][ALL], trust["scores"][ALL]
    return (
        f"All four marks are right for {percent(right['share'])} of {right['people']} people, and "
        f"for {with_interval(scores['right above one half'])} of those with a `trust` of 0.5 or "
        f"more. The AUC of `trust` is {scores['AUC']}."
    )


def readers_line() -> str:
    trust = figures()["trust"]
    pose = trust["agreement"]["pose"]
    equal, kappa, people = re.findall(r"[\d.]+", pose)
    return (
        f"The numbers cover {trust['people']} people in {trust['photos']} photos. "
        f"{trust['readers']} readers, all {trust['read by']}, judged them, two to four for each "
        f"person. Two readers agree on {percent(float(equal))} of poses (kappa {kappa}, {people} "
        "people)."
    )


def children_line() -> str:
    figure = figures()["trust"]["children"]
    return f"All four marks are right for {right_text(figure)} children."


def right_text(figure: Mapping[str, Any]) -> str:
    """Return a share of people in words; a count where they are few."""
    people = figure["people"]
    if not people:
        return "-"
    if people < FEW:
        return f"{round(figure['share'] * people)} of {people}"
    return f"{percent(figure['share'])} of {people}"


def truth_table() -> str:
    truth = figures()["truth"]
    return table(
        ("figure", "value", "95 % interval", "of"),
        (
            (
                row["name"],
                f"{row['value']:.{row['digits']}f}",
                f"{row['low']:.{row['digits']}f} to {row['high']:.{row['digits']}f}",
                str(row["count"]),
            )
            for row in truth["rows"]
        ),
        3,
    )


def truth_line() -> str:
    truth = figures()["truth"]
    photos = ", ".join(f"{count} of {name}" for name, count in truth["photos"].items() if count)
    return f"Preset `{truth['preset']}` at commit {truth['commit']}, {photos}:"


def given_bodies_table() -> str:
    sets = figures()["given_bodies"]["sets"]
    return table(
        ("photos", "people", "better", "MPJPE, mm", "relative to the hips, mm", "lower foot, cm"),
        (
            (
                name,
                str(one["people"]),
                str(one["better"]),
                *(" -> ".join(map(str, one[key])) for key in ("mpjpe", "root", "foot_cm")),
            )
            for name, one in sets.items()
        ),
        5,
    )


def cost_line() -> str:
    cost = figures()["cost"]
    rows = [
        f"`{photo}`: {one['cpu_s']:.0f} s of CPU time, {one['memory_gb']:.1f} GB of memory, "
        f"{one['written_mb']:.0f} MB of files"
        for photo, one in cost["photos"].items()
    ]
    return (
        f"{'; '.join(rows)} (medians of {cost['rounds']} runs at commit {cost['commit']} on "
        f"{cost['machine']})."
    )


def checks_table(of: str) -> str:
    figure_of = figures()["trust"]["where a check fails"]
    head = ["label", "name", "value", "limit"]
    people = of == "person"
    return table(
        [*head, "right if it fails"] if people else head,
        (
            [
                spec.label,
                f"`{spec.name}`",
                value_of(spec) + (" (if measured)" if spec.optional else ""),
                limit_of(spec),
                *(
                    [right_text(figure_of[spec.name]) if spec.name in figure_of else "not measured"]
                    if people
                    else []
                ),
            ]
            for spec in CHECKS.values()
            if spec.of == of
        ),
        int(people),
    )


def value_of(spec: CheckSpec) -> str:
    """Return what a check measures, from the first paragraph of its docstring."""
    return summary(spec.measure).removeprefix("Return ").removeprefix("the ").rstrip(".")


def summary(thing: object) -> str:
    """Return the first paragraph of a docstring as Markdown."""
    return as_markdown((inspect.getdoc(thing) or "").partition("\n\n")[0])


def as_markdown(text: str) -> str:
    """Return text of a docstring with the code of Markdown, in one line."""
    roles = r":\w+:`(?:[\w.]+\.)?(\w+)`|``(.+?)``"
    return re.sub(roles, lambda m: f"`{m[1] or m[2]}`", " ".join(text.split()))


def limit_of(spec: CheckSpec) -> str:
    return spec.compare(spec.threshold).bound_text.removeprefix("must be ")


def exports_table() -> str:
    rows = sorted((exporter.record for exporter in find_exporters()), key=lambda one: one.name)
    return table(
        ("`--to`", "for", "`--up`", "options"),
        (
            (
                f"`{one.name}`",
                one.audience,
                ", ".join(f"`{up}`" for up in one.ups),
                ", ".join(f"`--{option.replace('_', '-')}`" for option in one.options),
            )
            for one in rows
        ),
    )


def exit_codes_table() -> str:
    return table(("code", "meaning"), ((str(c), text) for c, text in MEANINGS.items()))


def backends_table() -> str:
    offers = [
        offer
        for offer in list_backends()
        if offer.distribution.startswith("metricbody") and offer.name != "mock"
    ]
    return table(
        ("interface", "backend", "license of the weights"),
        ((offer.interface, f"`{offer.name}`", license_of(offer)) for offer in offers),
    )


def license_of(offer: Offer) -> str:
    """Return the licenses of the weights that a backend uses by default."""
    kind = load_class(offer)
    defaults = {name: field.get_default() for name, field in kind.Options.model_fields.items()}
    sets = named_sets(offer.distribution, defaults)
    return licence_text(sets) or kind.weights_license or "-"


def interfaces_table() -> str:
    return table(
        ("interface", "what it does"),
        ((f"`{name}`", summary(kind)) for name, kind in interfaces.INTERFACES.items()),
    )


def packages_table() -> str:
    files = sorted((ROOT / "physic_core").glob("*/__init__.py"))
    return table(("package", "content"), ((f"`{f.parent.name}`", content_of(f)) for f in files))


def distributions_table() -> str:
    rows = (
        (f"[{folder.name}]({folder.name}/README.md)", f"`{file.parent.name}`", content_of(file))
        for folder in sorted((ROOT / "plugins").glob("*/"))
        for file in sorted(folder.glob("physic_*/__init__.py"))
    )
    return table(("folder", "package", "content"), rows)


def content_of(package: Path) -> str:
    """Return the first paragraph of the docstring of a package's file."""
    doc = ast.get_docstring(ast.parse(package.read_text(encoding="utf-8"))) or ""
    return as_markdown(doc.partition("\n\n")[0]).rstrip(".")


def arrays_table() -> str:
    homes = {
        "": Reconstruction,
        "scene.": Scene,
        "people.{i}.": Person,
        "people.{i}.parameters.": BodyParameters,
    }
    return table(
        ("array", "shape", "meaning"),
        (
            (
                f"`{home}{field.name}`",
                " x ".join(map(str, field.metadata["shape"])).replace("N", "1"),
                as_markdown(meaning_of(kind, field.name)),
            )
            for home, kind in homes.items()
            for field in fields(kind)
            if "shape" in field.metadata
        ),
    )


def meaning_of(kind: type, name: str) -> str:
    """Return what the docstring of a dataclass says of a field, without its shape."""
    doc = inspect.getdoc(kind) or ""
    match = re.search(rf"^    {name}: (?:\([\w, ]*\) ?)?((?:.+\n(?!    \w+:))*.+)", doc, re.M)
    assert match is not None, (kind, name)
    return match[1].lstrip(", ").rstrip(".")


def columns_table() -> str:
    columns = (c for c in PERSON_COLUMNS.values() if not c.name.startswith("right_"))
    return table(("column", "meaning"), ((f"`{c.name}`", c.meaning) for c in columns))


def layers(container: str) -> str:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (names,) = (
        contract["layers"]
        for contract in project["tool"]["importlinter"]["contracts"]
        if contract.get("containers") == [container]
    )
    return "\n".join(["```text", *names, "```"])


def parts() -> dict[str, Callable[[], str]]:
    """Return what writes each part, by name."""
    captions = {
        f"caption-of-{name}": lambda shown=shown: docs_numbers.caption(shown)
        for name, shown in docs_numbers.read_numbers().items()
    }
    return captions | {
        "marks": marks_table,
        "marks-in-a-line": marks_line,
        "all-marks": all_marks_line,
        "readers": readers_line,
        "children": children_line,
        "truth": truth_table,
        "truth-of": truth_line,
        "cost": cost_line,
        "given-bodies": given_bodies_table,
        "checks-of-the-photo": lambda: checks_table("photo"),
        "checks-of-a-person": lambda: checks_table("person"),
        "exports": exports_table,
        "exit-codes": exit_codes_table,
        "backends": backends_table,
        "interfaces": interfaces_table,
        "arrays": arrays_table,
        "columns": columns_table,
        "packages-of-the-core": packages_table,
        "distributions": distributions_table,
        "layers-of-the-core": lambda: layers("physic_core"),
        "layers-of-the-engine": lambda: layers("physic_core.engine"),
    }


def pages() -> list[Path]:
    """Return the pages with such parts."""
    files = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("*/*.md")]
    return sorted({page for page in files if _PART.search(page.read_text(encoding="utf-8"))})


def renewed(text: str) -> str:
    """Return a page with its parts as they are now."""
    texts = parts()
    return _PART.sub(lambda match: f"{match[1]}{texts[match[2]]()}\n", text)


def old_pages() -> list[str]:
    """Return the pages that state anything else."""
    texts = {page: page.read_text(encoding="utf-8") for page in pages()}
    return [str(page.relative_to(ROOT)) for page, text in texts.items() if renewed(text) != text]


def write_pages() -> None:
    """Renew all pages."""
    for page in pages():
        page.write_text(renewed(page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:] == ["--check"]:
        lines = [f"{page} is old: python tools/pages.py renews it" for page in old_pages()]
        sys.exit("\n".join(lines) or 0)
    write_pages()
