"""What all steps on one photo share: the stages before the optimisation, and calls of backends."""

from __future__ import annotations

from collections.abc import Iterable, Sized
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

from physic_core.errors import PhysicError
from physic_core.interfaces.backend import Result

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.configuration.resolve import ResolvedBackend, ResolvedPipeline
    from physic_core.interfaces import Request
    from physic_core.io.body_file import GivenBodies
    from physic_core.pipeline.stage_caller import StageCaller
    from physic_core.prepare.photo import PreparedPhoto
    from physic_core.types import UInt8Array

STAGES = {
    "people": "segmenter",
    "keypoints": "keypoint_detector",
    "inpainting": "inpainter",
    "scene point map": "relative_pointmap",
    "photo point map": "relative_pointmap",
    "observations": "person_observer",
    "floor candidates": None,
    "bodies": "body_estimator",
    "hands": "hand_estimator",
    "contact prior": "contact_prior",
    "floor and scale": None,
    "metric depth": "metric_depth",
}
"""Name of each stage before the optimisation -> the interface that it calls; None for one of the
engine. Metric depth may come after the scene, the contact prior, or floor and scale."""


def stages_before_the_engine(interfaces: Iterable[str]) -> int:
    """Return the number of stages with backends for these interfaces."""
    return sum(name in (None, *interfaces) for name in STAGES.values())


@dataclass(frozen=True)
class PhotoRun:
    """The run of all backends on one photo.

    Attributes:
        given: the photo, and what the user knows of it.
        plan: the backends and settings of the run.
        stages: calls the backends and records the run.
    """

    prepared: PreparedPhoto
    plan: ResolvedPipeline
    stages: StageCaller

    @property
    def image(self) -> UInt8Array:
        """The photo (H, W, 3) uint8 RGB."""
        return self.prepared.photo.image

    @cached_property
    def model(self) -> BodyModel:
        """The body model of the results; read from its file at the first use."""
        from physic_core.body import load_body

        return load_body(self.plan.body_model)

    @cached_property
    def bodies(self) -> GivenBodies | None:
        """Bodies of the model that the user gives; None without any."""
        if self.prepared.bodies is None:
            return None
        from physic_core.pipeline.backend_results import convert_to_configured
        from physic_core.prepare.bodies import in_configured_model

        given = self.prepared.bodies
        self.stages.note(*given.notes)
        bodies = given.bodies
        if bodies.body_model != self.model.name:
            bodies = convert_to_configured(bodies, self.model, given.source, self.stages)
        return in_configured_model(replace(given, bodies=bodies), self.model)

    def resolved(self, stage: str) -> ResolvedBackend:
        """Return the backend of a stage."""
        return self.plan.backends[STAGES[stage] or ""]

    def wants(self, stage: str, people: Sized) -> bool:
        """Return whether there are people, and a backend for a stage on them."""
        return STAGES[stage] in self.plan.backends and len(people) > 0

    def call(self, stage: str, request: Request[Result], *, last: bool = True) -> Result:
        """Call the backend of a stage; ``last`` if it is not called again."""
        return self.stages.call_backend(stage, self.resolved(stage), request, last=last)

    def call_optional(
        self, stage: str, request: Request[Result], *, otherwise: str
    ) -> Result | None:
        """Call the backend of a stage; None and a warning, what the run does ``otherwise``, if it
        fails.
        """
        try:
            return self.call(stage, request)
        except PhysicError as error:
            self.stages.warn_of_error(error, otherwise)
            return None

    def call_replaced(self, interface: str, request: Request[Result]) -> Result:
        """Call the backend that a file of the user's replaces, and close it.

        Raises:
            PhysicError: it cannot be used, such as without its weights.
        """
        from physic_core.configuration.resolve import resolve_one

        choice = getattr(self.plan.config, interface)
        resolved = resolve_one(interface, choice.backend, choice.options)
        try:
            return self.stages.call_backend(f"compared {interface}", resolved, request)
        finally:
            self.stages.close_backend(resolved)
