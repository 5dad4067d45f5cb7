"""Compare the sizes that the user knows with people placed in the scene, and with the result."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.body.posture import standing_legs
from physic_core.engine.measures import compare_statures, measure_known_sizes, pixel_text
from physic_core.engine.sizes.evidence import CONTRADICTION, likely_unit
from physic_core.engine.sizes.stature import STATURES_M
from physic_core.errors import ConfigError
from physic_core.geometry.tensors import exact_arrays
from physic_core.judge import CHECKS

if TYPE_CHECKING:
    from physic_core.engine.sizes.known_sizes import LocatedSizes
    from physic_core.engine.state import Estimates, State
    from physic_core.types import FloatArray, KnownSizes, Measures

_AGREES = 0.02  # difference of logarithms of a given and a resulting size


def check_placed_people(estimates: Estimates, before: State, placed: State) -> list[str]:
    """Compare people with a scene of known scale, before anything is optimized.

    Args:
        estimates: of the photo.
        before: with the bodies as estimated.
        placed: the same people in the scene.

    Returns:
        Warnings of people of unknown stature who would be impossibly tall or small.

    Raises:
        ConfigError: the photo contradicts a known stature, or most people of unknown stature would
            be impossibly tall or small, by more than three standard errors.
    """
    ratio = placed.size_ratio
    known = placed.known
    assert ratio is not None
    assert known is not None
    sizes = _scene_sizes(known)
    smallest, largest = STATURES_M
    statures, _ = estimates.photo.known.filled(len(ratio))
    shown_m = before.model.stature(before.betas) * ratio
    impossible = []
    surely = []
    measured = 0
    limit = CONTRADICTION if estimates.ground.measured is None else 0.0
    for i, (stature, shown_stature) in enumerate(
        zip(statures.tolist(), shown_m.tolist(), strict=True)
    ):
        if abs(math.log(shown_stature / stature)) > CONTRADICTION:
            raise ConfigError(
                f"the stature {stature:.2f} m of person {i} contradicts {sizes}, from which the "
                f"photo shows a person of {shown_stature:.2f} m: correct one of them, or leave "
                f"it out"
            )
        if math.isfinite(shown_stature) and not math.isfinite(stature):
            measured += 1
            excess = max(math.log(shown_stature / largest), math.log(smallest / shown_stature))
            impossible += [f"person {i} as {shown_stature:.2f} m tall"] if excess > 0 else []
            surely += [i] if excess > limit else []
    if 2 * len(surely) > measured:
        raise ConfigError(
            f"the photo contradicts {sizes}: in a scene of that size it shows "
            f"{', '.join(impossible)}; with people of usual stature it shows "
            f"{_scene_sizes(known, 1 / float(ratio[surely].median()))}. Correct the size, or leave "
            f"it out{_unit_hint(estimates)}"
        )
    return [
        f"in a scene of the given size the photo shows {person}: check the size, and in the "
        "preview whether the floor lies under the person's feet"
        for person in impossible
    ]


def _unit_hint(estimates: Estimates) -> str:
    """Return a question about the unit of a measured depth, or ""."""
    if estimates.ground.measured is None:
        return ""
    factor = estimates.ground.measured.depth_over_people
    return (
        f"; the depth is {factor:.3g} times that by the people: {likely_unit(factor)} Then "
        f"give --depth-unit"
    )


def _scene_sizes(known: LocatedSizes, factor: float = 1.0) -> str:
    """Name the camera height and the lengths on the scene, times a factor."""
    lengths = known.distances.metres[(known.distances.person < 0).all(1)].tolist()
    height = (
        []
        if known.camera_height is None
        else [f"the camera height {known.camera_height * factor:.3g} m"]
    )
    depth = []
    if known.depth_sigma is not None:
        depth = ["the given depth" if factor == 1 else f"{factor:.3g} of the given depth"]
    return " and ".join(
        depth + height + [f"the known length of {metres * factor:.3g} m" for metres in lengths]
    )


def compare_sizes(
    estimates: Estimates, people: list[Measures], before_joint: State, after_joint: State
) -> tuple[list[str], list[Measures], dict[str, Any]]:
    """Compare the known sizes with the result.

    Args:
        estimates: of the photo.
        people: measures of the people.
        before_joint: state of the people before stage 3.
        after_joint: after it.

    Returns:
        Warnings; the measures with the comparison; diagnostics of :func:`contradictions`.

    Raises:
        ConfigError: a size differs from the given one by more than three standard errors.
    """
    warnings, measured = contradictions(estimates.known, after_joint)
    growth = _growth_to_floor(people, after_joint)
    people = compare_statures(people, estimates, before_joint, after_joint, growth)
    limit = CHECKS["given_size"].threshold
    for i, (person, person_growth) in enumerate(zip(people, growth, strict=True)):
        sigmas = person.stature_sigmas
        if person_growth and sigmas is not None and sigmas <= limit:  # else the check warns
            warnings.append(
                f"person {i} does not stand on the floor with the given sizes: the photo shows "
                f"{person.shown_stature_m:.2f} m, but {person.given_stature_m:.2f} m was given or "
                "is usual; give sizes from left to right"
            )
    return warnings, people, measured


def _growth_to_floor(people: list[Measures], state: State) -> FloatArray:
    """Return the log factor (N,) by which people who stand off the floor must grow to stand on it;
    0 for others.
    """
    growth = np.zeros(len(people))
    floor = state.scene.floor
    for i, person in enumerate(people):
        height = person.sole_height_m
        if floor is None or height is None or abs(height) <= CHECKS["support"].threshold:
            continue
        # Not the stance: a body of a wrong size is placed where it seems not to stand.
        if standing_legs(*exact_arrays(state.joints[i])).all():
            # A person grows about the camera; a height near the camera's would need an infinite
            # factor.
            growth[i] = -math.log1p(
                -min(height / float(floor.offset * state.unapplied_scene_scale), 0.9)
            )
    return growth


def contradictions(known: KnownSizes, state: State) -> tuple[list[str], dict[str, Any]]:
    """Compare given sizes with those of the result.

    Returns:
        Warnings, and diagnostics: for each size its name, "given" and "result" in meters.

    Raises:
        ConfigError: a size differs from the given one by more than three standard errors.
    """
    if state.known is None:
        return [], {}
    warnings = []
    if known.camera_height is not None and state.scene.floor is None:
        warnings.append(
            f"the camera height {known.camera_height:g} m was not used: no plane was found for the "
            "floor; give a stature or a known length instead"
        )
    for length in (known.lengths[i] for i in state.known.unused):
        warnings.append(
            f"the known length of {length.metres:g} m was not used: the scene has no depth at one "
            f"of its pixels {pixel_text(length.start)} and {pixel_text(length.end)}; choose pixels "
            "away from edges and inside the photo"
        )
    sizes = measure_known_sizes(known, state)
    apart = max(
        (abs(math.log(max(value, 1e-9) / stated)) for _, stated, value in sizes), default=0.0
    )
    each = ", ".join(
        f"{name} is {value:.2f} m and was given as {stated:.2f} m" for name, stated, value in sizes
    )
    message = f"the given sizes contradict one another or the photo: in the result {each}"
    if apart > CONTRADICTION:
        raise ConfigError(f"{message}; correct the wrong one, or leave it out")
    if apart > _AGREES:
        warnings.append(f"{message}; check them, or omit the least certain one")
    return warnings, {
        "known_sizes": [
            {"name": name, "given": stated, "result": value} for name, stated, value in sizes
        ]
    }
