"""Known sizes of people: assign statures and ages to people, and resize their bodies."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_core.body.ages import ADULT_YEARS, load_ages
from physic_core.body.parameters import rotations_from_parameters
from physic_core.engine.sizes import resize_bodies
from physic_core.errors import InputError
from physic_core.geometry.tensors import tensor
from physic_core.types.known_sizes import KnownPeople

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.body.model import BodyModel
    from physic_core.types import Bodies, FloatArray, KnownSizes, People


def known_people(known: KnownSizes, people: People, *, chosen: bool = False) -> KnownPeople:
    """Return the known stature, metres, and age, years, of each of N people, NaN where unknown.

    Args:
        known: its statures and ages are in the order of the people if the user chose them, otherwise from left to
            right.
        people: found by the segmenter.
        chosen: whether the user chose the people.

    Raises:
        InputError: there are several statures or ages, but not one per person.
    """

    def find(name: str, given: tuple[float, ...]) -> FloatArray | None:
        return _per_person(given, name, people, chosen=chosen) if any(given) else None

    return KnownPeople(find("age", known.age), find("stature", known.stature))


def _per_person(given: tuple[float, ...], name: str, people: People, *, chosen: bool) -> FloatArray:
    count = len(people)
    if len(given) > 1 and len(given) != count:
        raise InputError(
            f"{len(given)} {name}s were given, but {count} {'person was' if count == 1 else 'people were'} found: give "
            f"one {name} for all, or one per person from left to right with 0 where it is unknown"
        )
    values = np.array(given * count if len(given) == 1 else given or (0.0,) * count, np.float64)
    boxes = np.asarray(people.boxes, np.float64).reshape(-1, 4)
    order = np.arange(count) if chosen else np.argsort(boxes[:, 0] + boxes[:, 2], kind="stable")
    found = np.full(count, np.nan)
    found[order] = np.where(values > 0, values, np.nan)
    return found


def bodies_of_stature(bodies: Bodies, model: BodyModel, statures: FloatArray, near: FloatArray | None = None) -> Bodies:
    """Give N bodies of the configured body model their known statures (N,), and keep their size in the image.

    A body that becomes larger moves away from the camera by the same factor. Its betas are the nearest to ``near``
    (N, K), or to the old ones.
    """
    parameters = bodies.parameters
    chosen = np.isfinite(statures) & np.isfinite(parameters.betas).all(1) & np.isfinite(parameters.transl).all(1)
    if not chosen.any():
        return bodies
    rows = parameters[chosen]
    exact = model.double
    betas, transl, ratio = resize_bodies(
        exact,
        rotations_from_parameters(rows).double(),
        tensor(rows.betas).double(),
        tensor(rows.transl).double(),
        torch.from_numpy(statures[chosen]),
        None if near is None else torch.from_numpy(near[chosen]),
    )

    def changed(values: FloatArray, new: Tensor) -> FloatArray:
        out = np.array(values)
        out[chosen] = new.numpy()
        return out

    factor = np.ones(len(statures))
    factor[chosen] = ratio.numpy()
    factor = factor[:, None, None]
    return replace(
        bodies,
        parameters=replace(
            parameters, betas=changed(parameters.betas, betas), transl=changed(parameters.transl, transl)
        ),
        joints=None if bodies.joints is None else np.asarray(bodies.joints * factor, bodies.joints.dtype),
        mesh=None
        if bodies.mesh is None
        else replace(bodies.mesh, vertices=np.asarray(bodies.mesh.vertices * factor, bodies.mesh.vertices.dtype)),
    )


def resize_children(bodies: Bodies, model: BodyModel, known: KnownPeople) -> tuple[Bodies, list[str]]:
    """Give people of known age under 16 a child's stature and shape; others are unchanged.

    Body estimators treat all people as adults, so children come out as adults farther away. The size of a child in the
    photo is preserved. A known stature overrides an age.

    Args:
        bodies: of N people, of the configured body model; people of known stature have it.
        model: the configured body model.
        known: by the user.

    Returns:
        The bodies, and a note about each child.
    """
    if known.years is None:
        return bodies, []
    betas = np.array(bodies.parameters.betas, np.float64)
    statures, notes, table = np.full(len(betas), np.nan), [], load_ages()
    for i in np.flatnonzero((known.years < ADULT_YEARS) & np.isfinite(betas).all(1)).tolist():
        mean, sigma = table.at_age(known.years[i])
        statures[i], spread = np.exp(mean), f" ± {100 * sigma:.0f} %"
        if known.stature is not None and np.isfinite(known.stature[i]):
            statures[i], spread = known.stature[i], ""
        notes.append(
            f"person {i} is a child of {known.years[i]:g} years, {statures[i]:.2f} m{spread} tall before the joint fit"
        )
    near = None
    if model.name == "embedded":
        children = np.isfinite(statures)
        betas[children] = table.betas(np.log(statures[children]))
        near = betas
    return bodies_of_stature(bodies, model, statures, near), notes
