"""The command ``physic simulate``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from physic_export.simulate import Motion


@click.command()
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--person", type=int, multiple=True, metavar="N", help="Only person N; may be repeated.")
@click.option("--seconds", type=click.FloatRange(0.1, 60), default=2.0, show_default=True, help="Simulated time.")
@click.option("--controls", is_flag=True, help="Also raised, on a tilted floor, without contact: no person may stay.")
@click.option(
    "--balance",
    is_flag=True,
    help="Turn people on their feet about the ankles until their mass is 4 cm inside the soles.",
)
@click.option("--body-model", type=click.Path(path_type=Path), metavar="FILE", help="Your SMPLX_*.npz.")
@click.option("-o", "--out", "folder", type=click.Path(path_type=Path), help="Folder to write.  [default: OUT]")
def simulate(
    out: Path,
    person: tuple[int, ...],
    seconds: float,
    controls: bool,
    balance: bool,
    body_model: Path | None,
    folder: Path | None,
) -> None:
    """Let the people of the result in folder OUT stand or sit under gravity in MuJoCo, with passive joints.

    Writes simulation.json, and simulation.png with each person before and after.
    """
    from functools import partial
    from importlib.util import find_spec

    import numpy as np

    from physic_core.errors import InputError, PackageMissingError

    if find_spec("mujoco") is None:
        raise PackageMissingError(
            "physic simulate needs mujoco, which is not installed: `pip install -e 'plugins/physic-export[simulate]'` "
            "in a checkout of PhySIC"
        )
    from physic_core.cli.output import echo
    from physic_core.files.atomic import atomic_write
    from physic_core.files.own import MARK, check_own
    from physic_core.types import Reconstruction
    from physic_core.visual.export.request import export_frame
    from physic_export.mjcf_humanoid import PASSIVE
    from physic_export.simulate import CONTROLS, simulate_people
    from physic_export.simulate_picture import draw_motions
    from physic_export.tiles import convex_tiles

    folder = folder or out
    check_own(folder / "simulation.json", folder / "simulation.png")
    result = Reconstruction.load(str(out))
    if result.scene.floor is None:
        raise InputError("physic simulate needs the direction of gravity, and this result has no floor")
    posed = [index for index, one in enumerate(result.people) if np.isfinite(one.vertices).all()]
    if missing := [index for index in person if index not in posed]:
        raise InputError(f"there is no person {missing[0]} with a body: choose from {posed}")
    motions: list[Motion] = []
    tiles = convex_tiles(result)
    run = partial(
        simulate_people, result, person or posed, seconds=seconds, balance=balance, body_file=body_model, tiles=tiles
    )
    for control in ("", *(CONTROLS if controls else ())):
        motions += run(control=control)
    echo(_table(motions))
    for turn in dict.fromkeys(motion.turn for motion in motions if motion.turn):
        echo(f"note: {turn}")
    for explanation in filter(None, (motion.explanation for motion in motions)):
        echo(f"note: {explanation}")
    names = {name: vars(passive) for name, passive in PASSIVE.items()}
    rows = [_row(motion) for motion in motions]
    document = {"note": MARK, "seconds": seconds, "passive_joints": names, "people": rows}
    folder.mkdir(parents=True, exist_ok=True)
    as_it_is = [one for one in motions if not one.control]
    picture = draw_motions(as_it_is, seconds, tiles, export_frame(result.scene.floor, "z").from_camera)
    with atomic_write(folder) as temporary:
        temporary("simulation.json").write_text(json.dumps(document, indent=2) + "\n", "utf-8")
        temporary("simulation.png").write_bytes(picture)
    echo(f"{folder / 'simulation.json'}\n{folder / 'simulation.png'}")


def _row(motion: Motion) -> dict[str, Any]:
    return {
        "person": motion.person,
        "posture": motion.posture,
        "control": motion.control,
        "stays": motion.stays,
        "outcome": motion.outcome,
        "turn": motion.turn or None,
        "unseen_supports": list(motion.unseen),
        "moved_m": round(motion.moved_m, 4),
        "slip_m": None if motion.slip_m is None else round(motion.slip_m, 4),
        "sinking_m": round(motion.sinking_m, 4),
        "contacts": motion.contacts,
        "lasting": motion.lasting,
    }


def _table(motions: list[Motion]) -> str:
    rows = [("person", "posture", "change", "outcome", "moved", "slip", "sinking", "contacts that last")]
    for one in motions:
        slip = "not measured" if one.slip_m is None else f"{100 * one.slip_m:.1f} cm"
        lasting = f"{one.lasting} of {one.contacts}" if one.contacts else "none in the result"
        moved, sinking = f"{100 * one.moved_m:.1f} cm", f"{100 * one.sinking_m:.1f} cm"
        rows.append((str(one.person), one.posture, one.control or "-", one.outcome, moved, slip, sinking, lasting))
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    )
