"""Surface energies by the equations of the terms, one operation after another: the slow twin of the
fused ones.
"""

from __future__ import annotations

import torch

from physic_core.engine.joint.sampling import root_relative
from physic_core.engine.joint.terms.picture import MIN_DEPTH_M
from physic_core.engine.joint.terms.scene import SLACK_M, lowest_height
from physic_core.geometry.robust import robust_loss
from physic_paper.terms.printed_regularisation import mesh_energies


def reference_surface_energies(data, vertices, pelvis, root, log_scale, offset):
    """Arguments and result as of ``surface_energies``."""
    scale = log_scale.exp()[:, None]
    signed = (data.normals.transpose(1, 2) * vertices).sum(-1) / scale - data.plane_distance
    height = (vertices @ data.floor_normal + data.floor_offset * scale) / scale
    # Invisible legs give the scale no gradient: they use the scale at the last refresh.
    at_last = (height * scale + data.floor_offset * (data.last_scale - scale)) / scale.detach()
    log_depth = vertices[..., 2].clamp(min=MIN_DEPTH_M).log()
    residuals = {
        "depth": lambda term: log_depth - term.log_map_depth - log_scale[:, None] - offset[:, None],
        "contact": lambda term: torch.where(term.on_scene, signed, height),
        "penetration": lambda term: torch.relu(-signed - SLACK_M),
        "floor": lambda term: torch.relu(-torch.where(term.eligible, height, at_last)),
    }
    energies = []
    for term, total in data.terms:
        square = (residuals[term.name](term) / total.sigma).square()
        loss = robust_loss(total.kind, square, c=total.scale)
        energies.append((total.weight * loss).sum(-1))
    relative = root_relative(vertices, pelvis, root)
    mesh = mesh_energies(relative, data.relative.transpose(1, 2), data.mesh_weight)
    lowest = [lowest_height(height.index_select(1, rows)) for rows in data.soles]
    return torch.stack([*energies, mesh]), torch.stack(lowest, 1)
