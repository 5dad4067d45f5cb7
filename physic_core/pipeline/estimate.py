"""Run the backends on one photo, in the order of the paper.

Each backend gets earlier results as hints. Bodies come before metric depth, so that a classical
depth backend can estimate its scale from the size of people. OpenCV camera frame.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.adapters.pictures import dilate
from physic_core.errors import ConfigError, NoPersonError
from physic_core.interfaces import (
    BodyEstimatorRequest,
    ContactPriorRequest,
    HandEstimatorRequest,
    InpainterRequest,
    KeypointDetectorRequest,
    MetricDepthRequest,
    PersonObserverRequest,
    RelativePointmapRequest,
    SegmenterRequest,
)
from physic_core.interfaces.bodies import valid_body_rows
from physic_core.pipeline.backend_results import (
    bodies_for_backends,
    convert_to_configured,
    discard_invalid_bodies,
    discard_invalid_hands,
    discard_invalid_keypoints,
    doubt_of_contact,
    expand_contact,
    real_people,
    replace_hands,
    transfer_contact,
)
from physic_core.types import (
    Bodies,
    ContactProbability,
    DepthMap,
    Hints,
    Intrinsics,
    Keypoints,
    KnownSizes,
    Observations,
    People,
    Pointmap,
)
from physic_core.types.arrays import select_people
from physic_core.types.known_sizes import KnownPeople
from physic_core.types.results import KNOWN_UP_SIGMA_DEG

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.configuration.resolve import ResolvedBackend, ResolvedPipeline
    from physic_core.engine.settings import EngineSettings
    from physic_core.engine.state import Estimates
    from physic_core.io.keypoint_file import GivenKeypoints
    from physic_core.pipeline.stage_runner import StageRunner
    from physic_core.types import BoolArray, PeoplePrompt, UInt8Array


_POINT_AT_PEOPLE = "if the photo shows one, point at them with --person x,y or --box x0,y0,x1,y1"


def run_backends(
    image: UInt8Array,
    given: Intrinsics | None,
    plan: ResolvedPipeline,
    load_model: Callable[[], BodyModel],
    stages: StageRunner,
    prompt: PeoplePrompt | None = None,
    sizes: KnownSizes | None = None,
    given_keypoints: GivenKeypoints | None = None,
) -> Estimates:
    """Run all backends on a photo.

    Args:
        image: (H, W, 3) uint8 RGB.
        given: camera of the photo, or None.
        plan: the backends and settings of the run.
        load_model: returns the body model that all bodies are converted to; not called before the
            bodies are estimated.
        stages: calls the backends and records the run.
        prompt: whom to reconstruct or to leave out, px of the image; None for all people.
        sizes: that the user knows, px of the image.
        given_keypoints: that replace detected ones, px of the image.

    Raises:
        ConfigError: a measured depth is a disparity.
        InputError: the number of known statures differs from that of the people, or given keypoints
            are of no person or joint.
        NoPersonError: a prompt selects no person, or people are required and the segmenter found
            none.
        BackendError: a required backend failed.
        BackendOutputError: a required backend returned an invalid result.
    """
    from physic_core.engine.floor import best_candidate, chosen_floor
    from physic_core.engine.floor_and_scale import (
        PeopleInScene,
        candidates_in,
        find_floor_and_scale,
        floor_evidence,
        plane_of,
    )
    from physic_core.engine.scene.measured_shape import (
        in_usual_unit,
        shows_people,
        with_measured_shape,
    )
    from physic_core.engine.sizes.evidence import is_inverse, is_measured
    from physic_core.engine.state import Estimates
    from physic_core.engine.up import contradiction, up_of_pointmap

    run = _BackendCalls(plan.backends, load_model, stages)
    sizes = sizes or KnownSizes()
    ignored = None
    if prompt is not None and prompt.ignored:
        ignored = prompt
        prompt = None
    found_people = run.people(image, prompt, required=plan.photo.require_people)
    if ignored is not None:
        found_people = run.without(found_people, ignored)
    real = real_people(found_people, prompt)
    people = run.select(found_people, real, "its joints lie on another person")
    if prompt is None:
        known, notes = _known_people(sizes, people, chosen=False)
    else:
        known, notes = _known_people(sizes, found_people, chosen=True)
        known = known.select(real)
        if not real.all():
            # The others have their pixels back only in a segmentation without the false persons.
            people = run.people(image, prompt.select(real), required=True)
    stages.note(*notes)
    keypoints = run.keypoints(image, people)
    changed = None
    contradicted = None
    if given_keypoints is not None:
        from physic_core.pipeline.known_people import contradicted_keypoints, corrected_keypoints

        detected = keypoints
        keypoints, changed, notes = corrected_keypoints(detected, given_keypoints, people)
        contradicted = contradicted_keypoints(detected, keypoints, changed, people)
        stages.note(*notes)

    hole = _removed(people, plan, image.shape)
    inpainted = run.inpainted(image, hole)
    # The inpainted photo gives the scene, the original photo the people's depth.
    hints = Hints(given, people, keypoints, hole, photo=image)
    scene = run.pointmap("scene point map", inpainted, hints, last=not hole.any())
    camera = given or scene.intrinsics or _camera_of(scene)
    whole = run.depth_of_photo(image)
    own = None if whole is None else _without(whole, hole)
    shape = whole if own is not None and is_measured(own) else None
    if own is not None and shape is not None:
        if is_inverse(own, scene):
            raise ConfigError(
                "the given depth is larger where the scene is nearer: it is a disparity, or "
                "inverse depth; give metres "
                "along the optical axis: focal length in px x distance of the two cameras in m / "
                "disparity in px"
            )
        scene = with_measured_shape(scene, own, scene.intrinsics or camera)
        share = (np.isfinite(own.depth) & scene.valid).sum() / max(1, (scene.valid & ~hole).sum())
        stages.note(
            f"the given depth is the shape of {share:.0%} of the scene, and the point map that of "
            f"the rest"
        )
    hints = replace(hints, intrinsics=camera, hole=None, photo=None, scene=scene)
    original = run.pointmap("photo point map", image, hints) if hole.any() else scene
    if own is not None and shape is not None and hole.any():
        original = with_measured_shape(original, own, original.intrinsics or camera)
        if shows_people(shape, original, scene, people.masks):
            original = with_measured_shape(original, shape, original.intrinsics or camera)
            original = replace(original, people_farther=None)
    if shape is not None:
        scene = in_usual_unit(scene)

    observations = run.observations(PersonObserverRequest(image, people, keypoints))
    with stages.time_engine("floor candidates"):
        aligned = _aligned(original, scene, hole, plan.engine) if hole.any() else scene
        evidence = floor_evidence(people, hole, keypoints, camera, observations, aligned)
        up = up_of_pointmap(scene)
        evidence = replace(evidence, up=up, shift_sigma=scene.shift_sigma or 0.0)
        floors = candidates_in(scene, evidence, plan.engine.scene)
        floor_by_pixels = plane_of(chosen_floor(floors, best_candidate(floors), evidence))

    hints = replace(hints, floor=floor_by_pixels, original=aligned, observations=observations)
    if up is not None and up.sigma < KNOWN_UP_SIGMA_DEG:
        hints = replace(hints, up=up.direction.numpy())
    bodies = run.bodies(BodyEstimatorRequest(image, people, camera, keypoints, hints), known)
    # Backends that need bodies get only people with finite bodies.
    embodied = ~run.missing["body_estimator"]
    seen = select_people(people, embodied)
    seen_bodies = bodies_for_backends(select_people(bodies, embodied), run.model)
    contact = run.contact(image, seen, seen_bodies, embodied)

    seen_keypoints = select_people(keypoints, embodied)
    seen_observations = select_people(observations, embodied)
    hints = replace(
        hints,
        people=seen,
        keypoints=seen_keypoints,
        observations=seen_observations,
        hole=hole,
        bodies=seen_bodies,
    )
    if own is None:
        own = run.depth_of_own_scale(MetricDepthRequest(inpainted, hints))
    with stages.time_engine("floor and scale"):
        given_people = PeopleInScene(
            scene,
            aligned,
            camera,
            seen,
            seen_keypoints,
            select_people(bodies, embodied),
            known.select(embodied),
            seen_observations,
        )
        witness = own if plan.engine.scene.rescales_depth else None
        found = find_floor_and_scale(floors, evidence, given_people, run.model, witness)
    stages.warn(*contradiction(found.search.plane, up, evidence.slope))
    depth = (
        found.depth
        or own
        or run.depth_of_scale(inpainted, replace(hints, floor=found.plane, scale=found.scale))
    )
    stages.note(*depth.notes)

    return Estimates(
        image=image,
        intrinsics=camera,
        camera_given=given is not None,
        people=people,
        keypoints=keypoints,
        hole=hole,
        inpainted=inpainted,
        scene=scene,
        original=original,
        floor=found.search,
        stance=found.stance.expanded(embodied),
        bodies=bodies,
        contact=contact,
        depth=depth,
        observations=observations,
        depth_by=plan.backends["metric_depth"].title,
        missing_results=tuple(
            tuple(name for name, who in run.missing.items() if who[i]) for i in range(len(people))
        ),
        ages=known.years,
        scale_guess=found.warning if own is None and depth.scale_sigma is None else "",
        scale_by_people=not found.warning
        and found.measured is None
        and (own is None or found.depth is not None),
        small={int(np.flatnonzero(embodied)[i]): tall for i, tall in found.small.items()},
        witnesses=_numbered(found.witnesses, embodied),
        known=sizes,
        measured_scale=found.measured,
        statures=known.stature,
        given_keypoints=changed,
        contradicted_px=contradicted,
        file_px=1.0 if given_keypoints is None else given_keypoints.file_px,
    )


def _numbered(
    witnesses: Mapping[str, list[dict[str, Any]]], embodied: BoolArray
) -> dict[str, list[dict[str, Any]]]:
    """Return witnesses with the numbers of all people in place of those of people with a body."""
    numbers = np.flatnonzero(embodied).tolist()
    return {
        name: [row | {"person": numbers[row["person"]]} if "person" in row else row for row in rows]
        for name, rows in witnesses.items()
    }


def _without(depth: DepthMap, hole: BoolArray) -> DepthMap | None:
    """Return a depth without the pixels of a hole; None if none is left."""
    rest = np.where(hole, np.nan, depth.depth)
    return replace(depth, depth=np.asarray(rest, np.float32)) if np.isfinite(rest).any() else None


def _known_people(
    sizes: KnownSizes, people: People, *, chosen: bool
) -> tuple[KnownPeople, tuple[str, ...]]:
    """Return what the user knows about the people, in their order if ``chosen``, else from left to
    right; and notes.
    """
    if not any(sizes.age) and not any(sizes.stature):
        return KnownPeople(), ()
    from physic_core.pipeline.known_people import known_people, who_got_which

    known = known_people(sizes, people, chosen=chosen)
    return known, () if chosen else who_got_which(sizes, known, people)


def _removed(people: People, plan: ResolvedPipeline, shape: tuple[int, ...]) -> BoolArray:
    """Return the inpainted pixels (H, W)."""
    hole = np.logical_or.reduce(people.masks)
    if people.unposed_mask is not None:
        hole |= people.unposed_mask
    return dilate(hole, max(4.0, plan.photo.mask_growth * max(shape[:2])))


@dataclass(frozen=True)
class _BackendCalls:
    """Calls the backends, and records people with non-finite results.

    Attributes:
        missing: interface -> (N,) bool, people without valid values from its backend.
    """

    backends: Mapping[str, ResolvedBackend]
    load_model: Callable[[], BodyModel]
    stages: StageRunner
    missing: dict[str, BoolArray] = field(default_factory=dict)

    @property
    def model(self) -> BodyModel:
        """The body model of the results."""
        return self.load_model()

    def people(self, image: UInt8Array, prompt: PeoplePrompt | None, *, required: bool) -> People:
        """Segment the people in an image, or those whom the user chose."""
        segmenter = self.backends["segmenter"]
        takes_prompt = getattr(segmenter.backend, "takes_prompt", False)
        request = SegmenterRequest(image, prompt=prompt if takes_prompt else None)
        people = self.stages.call_backend("people", segmenter, request)
        self.stages.note(*people.notes)
        if prompt is not None and not takes_prompt:
            from physic_core.pipeline.known_people import select_chosen

            people = select_chosen(people, prompt)
        if people.keypoints is not None:
            own, self.missing["segmenter"] = discard_invalid_keypoints(people.keypoints)
            people = replace(people, keypoints=own)
        if not len(people):
            cure = (
                _POINT_AT_PEOPLE
                if takes_prompt
                else "if the photo shows a person, use another segmenter"
            )
            if required:
                raise _nobody(image, segmenter.title, cure)
            self.stages.note(
                f"no person was found: the result is only the scene, and its scale is not "
                f"confirmed; {cure}"
            )
        return people

    def without(self, people: People, ignored: PeoplePrompt) -> People:
        """Return the people whom the user does not ignore; others' pixels show no scene."""
        from physic_core.pipeline.known_people import ignored_people

        out = ignored_people(people, ignored)
        masks: BoolArray = np.logical_or.reduce(people.masks[out])
        if people.unposed_mask is not None:
            masks |= people.unposed_mask
        return replace(self.select(people, ~out, "it is ignored"), unposed_mask=masks)

    def select(self, people: People, real: BoolArray, reason: str) -> People:
        """Return some (N,) bool of the people, with a note why each other one is left out."""
        for i in np.flatnonzero(~real):
            x0, y0, x1, y1 = people.boxes[i].round().astype(int).tolist()
            self.stages.note(f"left out the person in ({x0}, {y0}, {x1}, {y1}): {reason}")
        self.missing.update({name: missing[real] for name, missing in self.missing.items()})
        return select_people(people, real)

    def keypoints(self, image: UInt8Array, people: People) -> Keypoints:
        """Detect the keypoints of all people in an image."""
        if not len(people):
            return Keypoints(
                np.zeros((0, 17, 2), np.float32), np.zeros((0, 17), np.float32), "coco17"
            )
        detector = self.backends["keypoint_detector"]
        request = KeypointDetectorRequest(image, people)
        found = self.stages.call_backend("keypoints", detector, request)
        keypoints, self.missing["keypoint_detector"] = discard_invalid_keypoints(found)
        return keypoints

    def inpainted(self, image: UInt8Array, hole: BoolArray) -> UInt8Array:
        """Return an image without the pixels (H, W) of a hole."""
        if not hole.any():
            return image
        return self.stages.call_backend(
            "inpainting", self.backends["inpainter"], InpainterRequest(image, hole)
        )

    def pointmap(
        self, stage: str, image: UInt8Array, hints: Hints, *, last: bool = True
    ) -> Pointmap:
        """Estimate a relative point map of the inpainted or the original photo."""
        estimator = self.backends["relative_pointmap"]
        request = RelativePointmapRequest(image, hints)
        pointmap = self.stages.call_backend(stage, estimator, request, last=last)
        self.stages.note(*pointmap.notes)
        self.stages.warn(*pointmap.warnings)
        return pointmap

    def observations(self, request: PersonObserverRequest) -> Observations:
        """Ask what the people do; unknown without a backend, and if it fails."""
        unknown = Observations.unknown(len(request.people))
        if "person_observer" not in self.backends or not len(request.people):
            return unknown
        found = self.stages.call_optional_backend(
            "observations",
            self.backends["person_observer"],
            request,
            otherwise="what people do is told by their joints alone",
        )
        return unknown if found is None else found

    def bodies(self, request: BodyEstimatorRequest, known: KnownPeople) -> Bodies:
        """Estimate bodies with hands, of known stature or of a child's size; NaN for people without
        finite results.
        """
        bodies = self._bodies_without_hands(request)
        bodies = self._with_hands(
            HandEstimatorRequest(request.image, request.people, request.keypoints), bodies
        )
        from physic_core.engine.sizes.stature import bodies_of_stature, resize_children

        if known.stature is not None:
            bodies = bodies_of_stature(bodies, self.model, known.stature)
        observed = request.hints.observations
        assert observed is not None
        bodies, notes = resize_children(bodies, self.model, known, observed.child)
        self.stages.note(*notes)
        return bodies

    def _bodies_without_hands(self, request: BodyEstimatorRequest) -> Bodies:
        """Estimate bodies of the configured body model; NaN for people without finite results."""
        estimator = self.backends["body_estimator"]
        if not len(request.people):
            self.missing["body_estimator"] = np.zeros(0, bool)
            return _no_bodies(self.model)
        found = self.stages.call_backend("bodies", estimator, request)
        bodies, missing = discard_invalid_bodies(found)
        if bodies.body_model != self.model.name:
            bodies = convert_to_configured(bodies, self.model, estimator.title, self.stages)
            missing |= ~valid_body_rows(bodies)
        self.missing["body_estimator"] = missing
        return bodies

    def _with_hands(self, request: HandEstimatorRequest, bodies: Bodies) -> Bodies:
        """Add estimated finger rotations to bodies, if a hand estimator is configured and
        succeeds.
        """
        if "hand_estimator" not in self.backends or not len(request.people):
            return bodies
        otherwise = "fingers keep the pose from the body_estimator"
        found = self.stages.call_optional_backend(
            "hands", self.backends["hand_estimator"], request, otherwise=otherwise
        )
        if found is None:
            self.missing["hand_estimator"] = np.ones(len(request.people), bool)
            return bodies
        hands, self.missing["hand_estimator"] = discard_invalid_hands(found)
        return replace_hands(bodies, hands, self.model)

    def contact(
        self, image: UInt8Array, people: People, bodies: Bodies, embodied: BoolArray
    ) -> ContactProbability:
        """Predict contact probabilities of all N people; 0 without a backend or a body.

        ``people`` and ``bodies`` are those with a finite body, selected by ``embodied``, (N,) bool.
        """
        model = self.model
        n = len(embodied)
        none = ContactProbability(np.zeros((n, model.num_vertices), np.float32), model.topology)
        if "contact_prior" not in self.backends or not n:
            return none
        prior = self.backends["contact_prior"]
        otherwise = "contact is computed from distances only"
        request = ContactPriorRequest(
            image, people, bodies, topology=model.topology, vertices=model.num_vertices
        )
        found = self.stages.call_optional_backend(
            "contact prior", prior, request, otherwise=otherwise
        )
        if found is not None and found.topology != model.topology:
            found = transfer_contact(found, model, prior.title, self.stages)
        if found is None:
            self.missing["contact_prior"] = np.ones(n, bool)
            return none
        if doubt := doubt_of_contact(found, bodies):
            self.stages.warn(f"{prior.title}: {doubt}")
        contact, self.missing["contact_prior"] = expand_contact(found, embodied)
        return contact

    def depth_of_photo(self, image: UInt8Array) -> DepthMap | None:
        """Return the depth (H, W) of the photo with its people; None if the backend sees the
        inpainted one.
        """
        chosen = self.backends["metric_depth"]
        if chosen.backend.sees != "photo":
            return None
        return self.stages.call_backend("metric depth", chosen, MetricDepthRequest(image))

    def depth_of_own_scale(self, request: MetricDepthRequest) -> DepthMap | None:
        """Estimate metric depth; None if the backend scales its depth by the hints, or needs people
        and gets none.
        """
        chosen = self.backends["metric_depth"]
        if "scale" in (chosen.backend.reads or ()):
            return None
        try:
            return self.stages.call_backend("metric depth", chosen, request)
        except NoPersonError:
            return None

    def depth_of_scale(self, inpainted: UInt8Array, hints: Hints) -> DepthMap:
        """Return the metric depth of the inpainted photo at the scale of the hints.

        If the backend needs people and gets none, it is the depth of the scene.
        """
        from physic_core.engine.sizes.scale_vote import scaled_depth

        chosen = self.backends["metric_depth"]
        if "scale" in (chosen.backend.reads or ()):
            with suppress(NoPersonError):
                return self.stages.call_backend(
                    "metric depth", chosen, MetricDepthRequest(inpainted, hints)
                )
        assert hints.scene is not None
        assert hints.scale is not None
        return scaled_depth(hints.scene, hints.scale, hints.intrinsics)


def _nobody(image: UInt8Array, segmenter: str, cure: str) -> NoPersonError:
    height, width = image.shape[:2]
    return NoPersonError(
        f"no person was found in the photo of {width} x {height} px by {segmenter}: {cure}; "
        f"without require_people, "
        "the result is the scene alone"
    )


def _no_bodies(model: BodyModel) -> Bodies:
    """Return zero bodies of a body model."""
    from physic_core.body.bones import parameters_from_rotations

    rotations, betas, transl = model.zero_pose(0)
    expression = betas.new_zeros(0, model.num_expression)
    return Bodies(parameters_from_rotations(rotations, betas, expression, transl), model.name)


def _camera_of(pointmap: Pointmap) -> Intrinsics:
    from physic_core.geometry.pointmap import intrinsics_from_pointmap
    from physic_core.geometry.tensors import tensor

    height, width = pointmap.valid.shape
    fx, fy, cx, cy = intrinsics_from_pointmap(tensor(pointmap.points), tensor(pointmap.valid))
    return Intrinsics(fx, fy, cx, cy, width, height, "point map")


def _aligned(
    original: Pointmap, scene: Pointmap, hole: BoolArray, settings: EngineSettings
) -> Pointmap:
    from physic_core.engine.placement.solve import align_photo_points_to_scene
    from physic_core.geometry.alignment import apply_alignment
    from physic_core.geometry.tensors import tensor

    points = tensor(scene.points)
    valid = tensor(scene.valid)
    alignment = align_photo_points_to_scene(
        original, tensor(hole), points, valid, settings.placement
    )
    aligned = apply_alignment(tensor(original.points), alignment).numpy()
    return replace(original, points=aligned, unknown=scene.unknown)
