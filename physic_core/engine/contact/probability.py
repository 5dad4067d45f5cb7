"""Probability of contact with skin and objects: a fitted logistic model over named features for
each kind of contact, and for body parts. That of contact with the scene follows from the body part,
see :mod:`.parts`.

The coefficients, the script that made them, its data, and the error on held-out data are in
``coefficients.json``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import torch
from torch import Tensor

from physic_core.engine.contact.features import KINDS, Columns
from physic_core.engine.touch import IN_WORLDS, touch_log_odds

SUREST_VERTICES = 10
"""Number of vertices whose mean probability decides whether their body part touches."""


@dataclass(frozen=True)
class ContactModel:
    """Coefficients of the log odds of contact.

    Attributes:
        vertex: kind of contact -> name of a feature -> coefficient; see
            :mod:`physic_core.engine.contact.features`.
        nearness: "far_m", by which a vertex that is farther than its part has half of its
            probability, and the power "facing" of the cosine between skin and surface; both also
            for hands and feet.
        part: "constant" and "log odds" of the mean probability of the ten most probable vertices ->
            coefficient of the log odds that a body part touches its partner.
    """

    vertex: Mapping[str, Mapping[str, float]]
    part: Mapping[str, float]
    nearness: Mapping[str, float]

    def probabilities(self, columns: Mapping[str, Columns]) -> Tensor:
        """Return the probability (K, N, V) of each of the ``KINDS`` of contact; 0 for a kind that
        ``columns`` lacks.

        Raises:
            KeyError: a column is missing.
        """
        like = columns["own body"]["constant"]
        found = []
        for kind in KINDS:
            if kind not in columns:
                found.append(torch.zeros_like(like))
                continue
            log_odds = torch.zeros_like(like)
            for name, weight in self.vertex[kind].items():
                log_odds = log_odds + weight * columns[kind][name]
            found.append(torch.sigmoid(log_odds))
        return torch.stack(found)

    def part_probability(self, vertices: Tensor, *, on_skin: bool) -> float:
        """Return the probability that a body part touches skin, or an object, by those (n,) of its
        vertices.
        """
        odds = torch.logit(torch.tensor(mean_of_surest(vertices), dtype=torch.float64), 1e-6)
        odds = self.part["constant"] + self.part["log odds"] * odds
        return float(
            torch.sigmoid(
                torch.as_tensor(touch_log_odds("skin", {IN_WORLDS: odds}) if on_skin else odds)
            )
        )


def mean_of_surest(vertices: Tensor) -> float:
    """Return the mean of the ten largest of the probabilities (n,) of vertices, or of all if there
    are fewer.
    """
    return float(vertices.double().topk(min(SUREST_VERTICES, len(vertices))).values.mean())


@cache
def contact_model() -> ContactModel:
    """Return the fitted model."""
    text = (files("physic_core.engine.contact") / "coefficients.json").read_text(encoding="utf-8")
    record = json.loads(text)
    return ContactModel(record["vertex"], record["part"], record["nearness"])
