"""Forward kinematics of the 55-joint tree, including bodies with a bind pose other than the T-pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Kinematics:
    """Rest joints as a linear function of the shape, and forward kinematics.

    Attributes:
        template: (J, 3) joints of the mean shape in the bind pose, metres.
        directions: (D, J * 3) derivative with respect to each shape (then expression) coefficient.
        bind_rot: (J, 3, 3) world rotation of each bone from the bind pose to the canonical T-pose; None if they
            are the same.
        ancestors: for each round of pointer doubling the (J + 1,) index of each joint's 2^k-th ancestor, J where there
            is none.
        parents: (J,) parent of each joint, the root its own.
    """

    template: Tensor
    directions: Tensor
    bind_rot: Tensor | None
    ancestors: tuple[Tensor, ...]
    parents: Tensor

    @classmethod
    def build(cls, template: Tensor, directions: Tensor, bind_rot: Tensor | None, parents: Sequence[int]) -> Kinematics:
        """Build from mean joints (J, 3), shape directions (D, J, 3), bind rotations (J, 3, 3), J parents (root: -1)."""
        none = len(parents)
        ancestor = [p if p >= 0 else none for p in parents] + [none]
        rounds = []
        while any(a != none for a in ancestor):
            rounds.append(torch.tensor(ancestor, device=template.device))
            ancestor = [ancestor[a] for a in ancestor]
        own_parent = torch.tensor([0, *parents[1:]], device=template.device)
        return cls(template, directions.flatten(1), bind_rot, tuple(rounds), own_parent)

    def rest_joints(self, coefficients: Tensor) -> Tensor:
        """Return the bind-pose joints (B, J, 3), metres, for shape coefficients (B, K), K <= D."""
        count = coefficients.shape[-1]
        flat = torch.addmm(self.template.reshape(1, -1), coefficients, self.directions[:count])
        return flat.view(-1, *self.template.shape)

    def transforms(self, rotations: Tensor, rest: Tensor) -> tuple[Tensor, Tensor]:
        """Compute the rigid motions of all bones for a pose.

        Pointer doubling: after round k every joint holds the product over its 2^k nearest ancestors, so the chain of
        11 levels takes four batched products.

        Args:
            rotations: (B, J, 3, 3) of each joint relative to its parent, identity = canonical T-pose.
            rest: (B, J, 3) joints in the bind pose.

        Returns:
            world: (B, J, 3, 4) rotation of each bone against the T-pose, and position of its joint.
            skinning: (B, J, 3, 4) rigid motion from the bind pose to the posed body.
        """
        batch = len(rotations)
        offsets = torch.cat([rest[:, :1], rest[:, 1:] - rest.index_select(1, self.parents[1:])], 1)[..., None]
        if self.bind_rot is not None:
            turned = self.bind_rot.index_select(0, self.parents[1:]) @ offsets[:, 1:]
            offsets = torch.cat([offsets[:, :1], turned], 1)
        identity = torch.eye(4, dtype=rotations.dtype, device=rotations.device)
        bottom = identity[3:].expand(batch, len(self.parents), 1, 4)
        local = torch.cat([torch.cat([rotations, offsets], -1), bottom], -2)
        product = torch.cat([local, identity.expand(batch, 1, 4, 4)], 1)
        for ancestor in self.ancestors:
            product = product.index_select(1, ancestor) @ product
        world = product[:, :-1, :3]
        rotation = world[..., :3] if self.bind_rot is None else world[..., :3] @ self.bind_rot
        shift = world[..., 3:] - rotation @ rest[..., None]
        return world, torch.cat([rotation, shift], -1)
