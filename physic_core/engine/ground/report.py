"""What is told of floor and scale beside the answer: rows of each witness, and notes about people
and planes that contradict it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.engine.ground.floor import FloorCandidate
from physic_core.engine.sizes.scale_vote import ScaleVote, Witnesses
from physic_core.engine.sizes.stature import ADULT_STATURE_M
from physic_core.engine.up import angle_deg
from physic_core.types import Plane
from physic_core.types.contacts import has_sole_on_floor
from physic_core.types.known_sizes import KnownPeople, size_option

if TYPE_CHECKING:
    from physic_core.types import BodyContact, BoolArray, FloatArray

SIZES_DISAGREE = 0.25
"""Logarithm of the ratio of two sizes of a person from which on a note or a warning names them."""
_RIVAL = 0.2  # probability of other floors, from which on a note names the likeliest
_RIVAL_DEG = 5.0  # off the chosen floor
_LARGEST_FACTOR = 5.0  # between two people's statures
_FEWEST_ON_FLOOR = 2  # people from whom each other's size follows


def size_notes(
    vote: ScaleVote, soles: Witnesses, torsos: Witnesses, stands: BoolArray
) -> tuple[str, ...]:
    """Return a note about each person whose size contradicts a vote on the scale; ``stands`` (N, 2)
    bool are feet.
    """
    on_floor = np.isfinite(soles.scale) & stands.any(1)
    ratio = (
        np.where(on_floor, vote.residuals(soles), np.nan)
        if on_floor.any()
        else vote.residuals(torsos)
    )
    return tuple(
        f"by all other evidence, person {i} is {_factor_text(-ratio[i])} times as tall as in the "
        f"result: this stature and distance may be wrong by that factor. "
        + (
            f"For a small person, give {size_option('--stature METERS', len(ratio))}, for a child "
            f"--age YEARS likewise; leave out a figure or picture with --ignore x,y"
            if ratio[i] > 0
            else f"If you know the height, give {size_option('--stature METERS', len(ratio))}"
        )
        for i in np.flatnonzero(np.abs(ratio) > SIZES_DISAGREE).tolist()
    )


def _factor_text(log_ratio: float) -> str:
    """Format a factor; one that no person can have only by its side."""
    if abs(log_ratio) > math.log(_LARGEST_FACTOR):
        return "more than 5" if log_ratio > 0 else "less than 0.2"
    return f"{math.exp(log_ratio):.2g}"


def rival_note(
    candidates: Sequence[FloorCandidate], weights: FloatArray, best: int
) -> tuple[str, ...]:
    """Return a note about the answers that contradict the chosen floor, if they are likely."""
    chosen = candidates[best].plane
    if chosen is None:
        return ()
    rivals = []
    for candidate, weight in zip(candidates, weights.tolist(), strict=True):
        if candidate.plane is None:
            rivals.append((weight, "the photo shows no floor"))
            continue
        angle = angle_deg(candidate.plane.normal, chosen.normal)
        if angle > _RIVAL_DEG:
            rivals.append((weight, f"the true floor is tilted by {angle:.0f}° against it"))
    if (total := sum(weight for weight, _ in rivals)) < _RIVAL:
        return ()
    return (
        f"the floor may be wrong (probability {total:.2f}): perhaps {max(rivals)[1]}. Before you "
        'use heights over it, compare its line in the view "From the side" of preview.png with '
        "the photo",
    )


def floor_witnesses(
    candidates: Sequence[FloorCandidate], nats: Sequence[Mapping[str, float]], weights: FloatArray
) -> list[dict[str, Any]]:
    """Return a row for each candidate, the likeliest first: where it is from, pitch of the camera,
    probability, and the nats of each witness.
    """
    rows = []
    for candidate, candidate_nats, weight in zip(candidates, nats, weights.tolist(), strict=True):
        fit = candidate.plane
        row: dict[str, Any] = {"source": "no floor" if fit is None else fit.source}
        if fit is not None:
            row["pitch_deg"] = -math.degrees(math.asin(float(fit.normal[2])))
        rows.append(row | {"probability": weight, "nats": dict(candidate_nats)})
    return sorted(rows, key=lambda row: -row["probability"])


def scale_witnesses(kinds: Mapping[str, Witnesses], vote: ScaleVote) -> list[dict[str, Any]]:
    """Return a row for each witness: logarithm of its scale over the answer, standard deviation of
    that, and the probability that it is right.
    """
    rows = []
    for name, kind in kinds.items():
        numbers = (
            vote.residuals(kind),
            np.hypot(kind.sigma, kind.shared_sigma),
            vote.right_probability(kind),
        )
        for i, (away, sigma, right) in enumerate(np.stack(numbers, 1).tolist()):
            if math.isfinite(away):
                row: dict[str, Any] = {"by": name}
                if name in ("size", "soles"):
                    row["person"] = i
                rows.append(row | {"log_ratio": away, "sigma": sigma, "right": right})
    return rows


def small_statures(
    vote: ScaleVote, soles: Witnesses, stands: BoolArray, known: KnownPeople
) -> dict[int, float]:
    """Return the stature of people of unknown size who are too small for adults; feet ``stands``
    (N, 2) bool stand.
    """
    on_floor = np.isfinite(soles.scale) & stands.any(1)
    unknown = np.isnan(known.filled(len(stands))).all(0)
    if on_floor.sum() < _FEWEST_ON_FLOOR:
        return {}
    ratio = np.where(on_floor & unknown, vote.residuals(soles), -np.inf)
    return {
        int(i): ADULT_STATURE_M * math.exp(-ratio[i])
        for i in np.flatnonzero(ratio > SIZES_DISAGREE)
    }


def scale_note(
    contacts: Sequence[Sequence[BodyContact]],
    bodies: int,
    floor: Plane | None,
    lie: bool,
    sigma: float | None,
) -> str:
    """Return a note about the people who give the scale.

    Args:
        contacts: final ones of each person.
        bodies: number of people with a body.
        floor: of the result.
        lie: whether the floor is what people lie on.
        sigma: standard deviation of the logarithm of the scale.
    """
    stand = sum(has_sole_on_floor(person) for person in contacts)
    if floor is not None and stand and not lie:
        origin = (
            f"where the feet of {_people_text(stand)} touch the floor, and on the body's height"
        )
    else:
        if lie:
            why = "who probably lie"
        elif stand:
            why = "because no floor was detected"
        else:
            why = "because no feet on a floor are visible"
        origin = f"the usual height of {_people_text(bodies)}, {why}"
    option = size_option("--stature METERS", len(contacts))
    error = "" if sigma is None else f", and may be off by {sigma:.0%} (one standard deviation)"
    return f"all sizes depend mainly on {origin}{error}. If you know a height, give {option}"


def _people_text(count: int) -> str:
    """Format the number of people."""
    return "1 person" if count == 1 else f"{count} people"
