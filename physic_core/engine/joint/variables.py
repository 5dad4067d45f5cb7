"""Free parameters of the joint optimisation: bodies, scene scale, and a depth offset per person.

The parameters are whitened: deviations from the start, divided by their expected sizes. One step
length then suits all, and their sum of squares is a Gaussian prior. OpenCV camera frame, metres.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_NAMES
from physic_core.engine.sizes.evidence import DEPTH_SCALE_SIGMA
from physic_core.geometry.rotvecs import rotvec_to_rotmat
from physic_core.types.short_repr import ShortRepr

PARAMETER_GROUPS: tuple[str, ...] = (
    "root",
    "pose",
    "hands",
    "betas",
    "translation",
    "scale",
    "offset",
)
"""Parameter groups: root rotation, rotations of body joints 1-21 and of both hands, shape,
translation, scene scale and depth offset.
"""

_OF_PEOPLE = tuple(group for group in PARAMETER_GROUPS if group != "scale")

BODY = slice(JOINT_NAMES.index("left_hip"), JOINT_NAMES.index("jaw"))
FACE = slice(JOINT_NAMES.index("jaw"), JOINT_NAMES.index("left_index1"))
HANDS = slice(JOINT_NAMES.index("left_index1"), len(JOINT_NAMES))
"""Body joints 1-21, jaw and eyes, and the joints of both hands, among the 55 joints."""

_POSE_SIGMAS: dict[str, float | tuple[float, float, float]] = {
    # joint: expected correction of a fitted pose, radians about the joint's own x, y, z; 0.4 of the
    # standard deviation of people's poses, within 0.05 and 0.3. Knees bend about x, elbows about y;
    # the other axes of a hinge hardly move.
    "hip": (0.3, 0.2, 0.2),
    "knee": (0.3, 0.05, 0.05),
    "ankle": 0.14,
    "foot": 0.05,
    "spine": (0.1, 0.08, 0.06),
    "neck": 0.1,
    "head": 0.1,
    "collar": 0.06,
    "shoulder": 0.3,
    "elbow": (0.12, 0.3, 0.06),
    "wrist": 0.14,
}
_ROOT_SIGMA = 0.3  # radians
_HAND_SIGMA = 0.15  # radians
_BETA_SIGMA = 0.5
RAY_SIGMA = 0.01
"""Expected correction of x / z and y / z of a body."""
DEPTH_SIGMA = 0.05
"""Expected correction of log z of a body."""


@dataclass(frozen=True)
class Estimate(ShortRepr):
    """Parameters of bodies and scene, converted from the free parameters.

    Attributes:
        rotations: (B, 55, 3, 3).
        betas: (B, K).
        transl: (B, 3) metres.
        log_scale: () log of the factor on the scene.
        offset: (B,) log of the ratio between the depth map at each person and the scene's depth.
        log_scales: (B,) ``log_scale`` of each person, which are equal, for derivatives by person.
    """

    rotations: Tensor
    betas: Tensor
    transl: Tensor
    log_scale: Tensor
    offset: Tensor
    log_scales: Tensor


def _fixed_turns(rotations: Tensor) -> tuple[Tensor, Tensor]:
    """Return the rotations (B, n, 3, 3) before and after a free turn: of the root it is the last,
    of other joints the first.
    """
    others = torch.cat([rotations[:, BODY], rotations[:, HANDS]], 1)
    one = torch.eye(3).to(rotations).expand(len(rotations), 1, 3, 3)
    before = torch.cat([one, others], 1)
    return before, torch.cat([rotations[:, :1], one.expand_as(others)], 1)


def _turn_sigmas(like: Tensor) -> Tensor:
    """Return the expected corrections (n, 3) of the root, the body's joints and those of hands."""
    pose = like.new_empty(len(JOINT_NAMES[BODY]), 3)
    for row, name in zip(pose, JOINT_NAMES[BODY], strict=True):
        row[:] = row.new_tensor(_POSE_SIGMAS[name.rpartition("_")[2].rstrip("123")])
    hands = like.new_full((len(JOINT_NAMES[HANDS]), 3), _HAND_SIGMA)
    return torch.cat([like.new_full((1, 3), _ROOT_SIGMA), pose, hands])


class Variables:
    """Free parameters of B people and their scene.

    A subclass may parametrise them otherwise, by ``_initial_values`` and ``unpack``.

    Attributes:
        scale_shares: (B,) zeros that are added to each person's scale: the gradient by one of them
            is that of one person's energy by the scale.

    Args:
        rotations: (B, 55, 3, 3) at the start.
        betas: (B, K) at the start.
        transl: (B, 3) metres, at the start.
        pelvis: (B, 3) metres, the pelvis joint at the start. Translations are along and across its
            ray.
        frozen: groups of :data:`PARAMETER_GROUPS` that are kept constant.
        scale_sigma: expected size of log(scale).
        offset_sigma: expected size of the log depth offsets; (B,) differs per person. 0 fixes the
            offset.
    """

    def __init__(
        self,
        rotations: Tensor,
        betas: Tensor,
        transl: Tensor,
        pelvis: Tensor,
        *,
        frozen: Sequence[str] = (),
        scale_sigma: float = DEPTH_SCALE_SIGMA,
        offset_sigma: float | Tensor = 0.2,
    ) -> None:
        people = len(rotations)
        self.start = Estimate(
            rotations.detach(),
            betas.detach(),
            transl.detach(),
            rotations.new_zeros(()),
            rotations.new_zeros(people),
            rotations.new_zeros(people),
        )
        self._pelvis = pelvis.detach()
        self._sigmas: dict[str, Tensor | float] = {
            "betas": _BETA_SIGMA,
            "translation": rotations.new_tensor([RAY_SIGMA, RAY_SIGMA, DEPTH_SIGMA]),
            "scale": scale_sigma,
            "offset": offset_sigma,
        }
        self._turn_sigmas = _turn_sigmas(rotations)
        self._before, self._after = _fixed_turns(rotations.detach())
        self._ray = self._pelvis / self._pelvis[:, 2:]
        self._across = transl.new_tensor([1.0, 1.0, 0.0])
        self.offset_free = (transl.new_zeros(people) + offset_sigma) > 0
        self.scale_shares = transl.new_zeros(people).requires_grad_()
        self.values: dict[str, Tensor] = self._initial_values()
        self.free: tuple[str, ...] = tuple(g for g in PARAMETER_GROUPS if g not in frozen)
        for group in self.free:
            self.values[group].requires_grad_()
        self._origin = {group: value.detach().clone() for group, value in self.values.items()}
        self._origin_columns = self._concatenate(self._origin)
        self._sizes = [self._origin[group][0].numel() for group in _OF_PEOPLE]

    def _initial_values(self) -> dict[str, Tensor]:
        """Return the free parameters at the start, by group."""
        start = self.start
        rotvecs = torch.zeros_like(self.start.rotations[..., 0])
        return {
            "root": torch.zeros_like(start.transl),
            "pose": rotvecs[:, BODY].clone(),
            "hands": rotvecs[:, HANDS].clone(),
            "betas": torch.zeros_like(start.betas),
            "translation": torch.zeros_like(start.transl),
            "scale": torch.zeros_like(start.log_scale),
            "offset": torch.zeros_like(start.offset),
        }

    def unpack(self) -> Estimate:
        """Convert the free parameters to bodies and scene; differentiable."""
        start = self.start
        values = self.values
        sigmas = self._sigmas
        # One call for all rotations. The root's is applied in the camera frame, the others in the
        # frame of their joint.
        rotvecs = (
            torch.cat([values["root"][:, None], values["pose"], values["hands"]], 1)
            * self._turn_sigmas
        )
        rotated = self._before @ rotvec_to_rotmat(rotvecs) @ self._after
        body, hands = torch.split(rotated, [FACE.start, rotated.shape[1] - FACE.start], dim=1)
        move = values["translation"] * sigmas["translation"]
        pelvis = (self._ray + move * self._across) * (self._pelvis[:, 2:] * torch.exp(move[:, 2:]))
        return Estimate(
            torch.cat([body, start.rotations[:, FACE], hands], 1),
            start.betas + values["betas"] * sigmas["betas"],
            start.transl + (pelvis - self._pelvis),
            values["scale"] * sigmas["scale"],
            values["offset"] * sigmas["offset"],
            (values["scale"] + self.scale_shares) * sigmas["scale"],
        )

    def deviation(self) -> tuple[Tensor, Tensor]:
        """Return the deviation of people's parameters (B, P) and of the scene's scale () from the
        start.

        Columns are all groups except the scale, in the order of :data:`PARAMETER_GROUPS`. Units are
        expected sizes.
        """
        return self._concatenate(self.values) - self._origin_columns, self.values[
            "scale"
        ] - self._origin["scale"]

    @property
    def expected_turns(self) -> Tensor:
        """Expected angles (22,) of correction of pelvis and body joints, radians."""
        angles: Tensor = self._turn_sigmas[: BODY.stop].norm(dim=-1)
        return angles

    def expand_to_parameters(self, of_group: Mapping[str, float]) -> Tensor:
        """Expand one number per parameter group to one per parameter: (P,), in the columns of
        :meth:`deviation`.
        """
        sizes = zip(_OF_PEOPLE, self._sizes, strict=True)
        return self._origin_columns.new_tensor(
            [of_group[group] for group, size in sizes for _ in range(size)]
        )

    @staticmethod
    def _concatenate(values: Mapping[str, Tensor]) -> Tensor:
        """Concatenate the parameters of people: (B, P)."""
        return torch.cat([values[g].reshape(len(values[g]), -1) for g in _OF_PEOPLE], 1)

    def parameters(self) -> list[Tensor]:
        """Return the leaf tensors of the free parameters."""
        return [self.values[group] for group in self.free]

    def pack(self) -> Tensor:
        """Return a copy of all free parameters in one vector (n,)."""
        none = self.start.transl.new_zeros(0)
        return torch.cat([none, *(v.detach().reshape(-1) for v in self.parameters())])

    @torch.no_grad()
    def load(self, packed: Tensor) -> None:
        """Set all free parameters from a vector of :meth:`pack`."""
        for value, part in zip(self.parameters(), self._parts(packed), strict=True):
            value.copy_(part.view_as(value))

    def split(self, packed: Tensor) -> tuple[Tensor, Tensor | None]:
        """Split a vector of :meth:`pack` into people's parameters (B, D), and the scale () if it is
        free.
        """
        parts = dict(zip(self.free, self._parts(packed), strict=True))
        scale = parts.pop("scale", None)
        rows = [part.reshape(self.num_people, -1) for part in parts.values()]
        people = torch.cat(rows, 1) if rows else packed.new_zeros(self.num_people, 0)
        return people, None if scale is None else scale[0]

    def merge(self, people: Tensor, scale: Tensor | None) -> Tensor:
        """Return the vector of :meth:`pack` from the parts of :meth:`split`."""
        sizes = [self.values[group][0].numel() for group in self.free if group != "scale"]
        columns = iter(torch.split(people, sizes, 1))
        none = people.new_zeros(0) if scale is None else scale.reshape(1)
        return torch.cat(
            [
                people.new_zeros(0),
                *(none if g == "scale" else next(columns).reshape(-1) for g in self.free),
            ]
        )

    @property
    def num_people(self) -> int:
        """Number of people B."""
        return len(self.start.transl)

    @torch.no_grad()
    def load_people(self, packed: Tensor, people: Tensor) -> None:
        """Set the parameters of the ``people`` (B,) bool from a vector of :meth:`pack`, without the
        scene's scale.
        """
        theirs, _ = self.split(packed)
        own, scale = self.split(self.pack())
        self.load(self.merge(torch.where(people[:, None], theirs, own), scale))

    @torch.no_grad()
    def people_changed(self, packed: Tensor) -> Tensor:
        """Return (B,) bool: people with a parameter that differs from a vector of :meth:`pack`."""
        theirs, _ = self.split(packed)
        own, _ = self.split(self.pack())
        return (own != theirs).any(1)

    def _parts(self, packed: Tensor) -> tuple[Tensor, ...]:
        """Split a packed vector into the free parameter groups."""
        return torch.split(packed, [v.numel() for v in self.parameters()])
