"""Scale the relative depth of a scene to metres by its people: soles on the floor where visible, else body size."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError, NoPersonError
from physic_core.interfaces import MetricDepth, Options
from physic_core.types import DepthMap
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.engine.sizes import PeopleVote, PersonScales
    from physic_core.types import Bodies, Hints

    FloatArray = NDArray[np.floating]

_LIMBS = ("shoulder", "hip", "knee", "ankle")
_FARTHEST_M = 1e4


class EmbeddedMetricDepthOptions(Options):
    """Settings of the embedded metric depth."""

    scale_by: Literal["auto", "soles", "torsos"] = Field(
        "auto", description="'soles' on the floor, 'torsos', or 'auto': soles where they are seen well, else torsos"
    )
    soles_sigma: float = Field(
        0.08, ge=1e-6, le=10, description="unknown part of a scale from soles: stature; standard deviation of the log"
    )
    torsos_sigma: float = Field(
        0.2, ge=1e-6, le=10, description="unknown part of a scale from torsos: stature and the person's depth"
    )
    disagreement: float = Field(
        1.7,
        gt=1,
        le=1e3,
        description="a person whose soles say this many times more or less than their torso stands elsewhere",
    )
    lifted_sigmas: float = Field(
        3.0,
        gt=0,
        le=1e3,
        description="feet are over the floor if the scale of their soles is less than that of standing people by this "
        "many standard deviations, which the point map states",
    )


class EmbeddedMetricDepth(MetricDepth):
    """Metric depth: the relative depth of the scene, scaled by the known size of the people.

    The scale that puts soles on the floor is the better one, because the relative depth of a person is often larger
    than that of the floor under their feet: with a scale from the torso they would sink into it.
    """

    Options: ClassVar[type[Options]] = EmbeddedMetricDepthOptions
    options: EmbeddedMetricDepthOptions
    reads = ("intrinsics", "people", "keypoints", "scene", "original", "floor", "bodies")

    _model: BodyModel | None = None

    def load(self, device: str = "cpu") -> None:
        """Do nothing: the body model is loaded when the bodies are known."""

    def close(self) -> None:
        """Release the body model."""
        self._model = None

    def infer(self, image: NDArray[np.uint8], hints: Hints) -> DepthMap:
        """Return the depth (H, W) of ``hints.scene`` in metres, scaled by ``hints.bodies``.

        Raises:
            BackendError: hints lack the scene or the bodies, or nobody can serve as the ruler.
            NoPersonError: there is no body.
        """
        from physic_core.engine.sizes import ScaleRule, scale_by_people

        if hints.scene is None or hints.bodies is None:
            missing = "scene" if hints.scene is None else "bodies"
            raise BackendError(
                f"the embedded metric depth needs hints.scene and hints.bodies, and hints.{missing} is missing: "
                "use it in the pipeline, which asks for both before it, or choose a metric depth network"
            )
        if not len(hints.bodies.parameters):
            raise NoPersonError("the embedded metric depth needs at least one person: choose a metric depth network")
        vertices, model = self._pose_bodies(hints.bodies)
        count = len(vertices)
        observed = hints.bodies.observed
        observed = np.ones((count, 55), bool) if observed is None else np.asarray(observed)
        options, scene = self.options, hints.scene
        shift_sigma = scene.shift_sigma if scene.unknown == "inverse_scale_shift" else None
        found = scale_by_people(
            self._scales(vertices, model, observed, hints),
            vertices[..., 2].mean(1),
            _visible_evidence(hints, count),
            shift_sigma or 0.0,
            ScaleRule(options.scale_by, options.soles_sigma, options.torsos_sigma, options.disagreement),
        )
        if found is None:
            raise BackendError(
                "the embedded metric depth found no soles on a floor and no torso in the relative depth: "
                "give hints.floor or hints.original, or choose a metric depth network"
            )
        vote = found.vote
        with np.errstate(divide="ignore"):
            inverse = (1 / np.where(hints.scene.valid, hints.scene.points[..., 2], np.nan) + vote.shift) / vote.scale
            depth = np.where(inverse > 1 / _FARTHEST_M, 1 / inverse, np.nan).astype(np.float32)
        return DepthMap(depth, hints.scene.intrinsics or hints.intrinsics, vote.sigma, tuple(_notes(found)))

    def _pose_bodies(self, bodies: Bodies) -> tuple[FloatArray, BodyModel]:
        """Return the vertices of the bodies and their model."""
        import torch

        from physic_core.body import load_body
        from physic_core.body.parameters import rotations_from_parameters
        from physic_core.geometry.tensors import tensor

        if self._model is None:
            self._model = load_body("embedded")
        if bodies.body_model != "embedded":
            from physic_core.body.convert.bodies import convert_bodies

            if bodies.joints is None:
                raise BackendError(
                    "the embedded metric depth needs bodies of the embedded model or joints, got "
                    f"{bodies.body_model!r} bodies without joints: use it in the pipeline, or choose a metric depth "
                    "network"
                )
            # A body of the same joints is as high as the one whose file is not ours.
            bodies = convert_bodies(replace(bodies, mesh=None), self._model)
        with torch.no_grad():
            p = bodies.parameters
            rotations = rotations_from_parameters(p)
            out = self._model(rotations, tensor(p.betas), tensor(p.transl))
        return out.vertices.double().numpy(), self._model

    def _scales(
        self, vertices: FloatArray, model: BodyModel, observed: NDArray[np.bool_], hints: Hints
    ) -> PersonScales:
        """Return the scales that the people give the scene.

        People come out farther than the floor that they stand on, so that a torso makes the floor too near.
        """
        from physic_core.engine.sizes import PersonScales, scales_by_soles, scales_by_torsos, standing_scores

        photo, soles = hints.original, np.full((len(vertices), 2), np.nan)
        torsos, lifted = np.full(len(vertices), np.nan), np.zeros(len(vertices), bool)
        if hints.floor is not None:
            soles = scales_by_soles(vertices, model, observed, hints.floor)
        camera = hints.intrinsics or (None if photo is None else photo.intrinsics)
        if photo is not None and hints.people is not None and camera is not None:
            torsos = scales_by_torsos(vertices, model, hints.people.masks, photo, camera.matrix)
            with np.errstate(invalid="ignore"):
                lifted = standing_scores(soles, torsos, photo) < -self.options.lifted_sigmas
            if photo.people_farther is not None:
                torsos = torsos * np.exp(photo.people_farther[0])
        return PersonScales(np.fmax(soles[:, 0], soles[:, 1]), torsos, lifted)


def _notes(found: PeopleVote) -> list[str]:
    """Describe who voted on the scale."""
    voters = _count_people(int(found.voters.sum()))
    notes = [
        f"the scale is from the soles of {voters} on the floor"
        if found.by_soles
        else f"the scale is from the body size of {voters}: soles on a visible floor would give it more exactly"
    ]
    if found.by_soles and found.elsewhere.any():
        others = _count_people(int(found.elsewhere.sum()))
        notes.append(f"{others} not used for the scale: their soles are not on the floor that was found")
    vote = found.vote
    if vote.outliers.any():
        others = _count_people(int(vote.outliers.sum()))
        split = ", about as well visible as the others: the scale is that of the best visible" if vote.split else ""
        notes.append(f"{others} would give the scene another scale{split}")
    return notes


def _visible_evidence(hints: Hints, count: int) -> FloatArray:
    """Return how well the photo shows each person, (N,): side of the mask's area times mean keypoint confidence."""
    weights = np.ones(count)
    if hints.people is not None:
        weights *= np.sqrt(np.maximum(np.asarray(hints.people.masks).sum((1, 2)), 1))
    if hints.keypoints is not None:
        row = {name: i for i, name in enumerate(hints.keypoints.joint_set.names)}
        used = [row[f"{side}_{joint}"] for side in SIDES for joint in _LIMBS if f"{side}_{joint}" in row]
        weights *= np.maximum(hints.keypoints.confidence[:, used].mean(1), 1e-3) if used else 1.0
    return weights


def _count_people(count: int) -> str:
    """Format a number of people."""
    return "1 person" if count == 1 else f"{count} people"
