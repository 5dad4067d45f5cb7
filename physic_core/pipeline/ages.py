"""Children of known age: their usual stature and shape."""

from __future__ import annotations

import numpy as np

from physic_core.body.ages import ADULT_YEARS, load_ages
from physic_core.body.model import BodyModel
from physic_core.pipeline.known_sizes import bodies_of_stature
from physic_core.types import Bodies
from physic_core.types.known_sizes import KnownPeople


def resize_children(bodies: Bodies, model: BodyModel, known: KnownPeople) -> tuple[Bodies, list[str]]:
    """Give people of a known age under 16 years a child's stature and shape; the others stay as they are.

    Body estimators take all people for adults, so that children come out as adults who are farther away. A child stays
    as large in the photo as before. A known stature counts more than an age.

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
