"""Pure functions on tensors: cameras, point maps, alignment, planes, neighbors, visibility, robust
losses.

Other packages use :mod:`.camera`, :mod:`.colors`, :mod:`.pointmap`, :mod:`.alignment`,
:mod:`.floor`, :mod:`.inverse_depth`, :mod:`.plane`, :mod:`.upright`, :mod:`.mesh`, :mod:`.rays`,
:mod:`.raster`, :mod:`.neighbors`, :mod:`.visibility`, :mod:`.robust`, :mod:`.rotations`,
:mod:`.rotvecs`, :mod:`.pixels` and :mod:`.tensors`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.lazy import importer

if TYPE_CHECKING:
    from physic_core.geometry.alignment import AlignmentOptions as AlignmentOptions
    from physic_core.geometry.camera import pixel_grid as pixel_grid
    from physic_core.geometry.camera import pixel_rays as pixel_rays
    from physic_core.geometry.camera import project as project
    from physic_core.geometry.camera import undistort_pixels as undistort_pixels
    from physic_core.geometry.camera import unproject as unproject
    from physic_core.geometry.colors import lab_from_srgb as lab_from_srgb
    from physic_core.geometry.colors import linear_from_srgb as linear_from_srgb
    from physic_core.geometry.floor import FOCAL_PITCH_DEG as FOCAL_PITCH_DEG
    from physic_core.geometry.floor import FloorSearch as FloorSearch
    from physic_core.geometry.floor import PlaneFit as PlaneFit
    from physic_core.geometry.floor import plane_of_pixels as plane_of_pixels
    from physic_core.geometry.inverse_depth import LOWER_SHARE as LOWER_SHARE
    from physic_core.geometry.inverse_depth import InverseDepthMap as InverseDepthMap
    from physic_core.geometry.mesh import coarse_mesh as coarse_mesh
    from physic_core.geometry.mesh import vertex_areas as vertex_areas
    from physic_core.geometry.mesh import vertex_normals as vertex_normals
    from physic_core.geometry.neighbors import NearestPointSearch as NearestPointSearch
    from physic_core.geometry.pointmap import pointmap_normals as pointmap_normals
    from physic_core.geometry.raster import rasterize as rasterize
    from physic_core.geometry.rays import RayCaster as RayCaster
    from physic_core.geometry.robust import robust_loss as robust_loss
    from physic_core.geometry.rotations import check_rotations as check_rotations
    from physic_core.geometry.rotations import cross as cross
    from physic_core.geometry.rotations import frame_from_axes as frame_from_axes
    from physic_core.geometry.rotations import nearest_rotation as nearest_rotation
    from physic_core.geometry.rotations import rotate as rotate
    from physic_core.geometry.rotations import rotation_between as rotation_between
    from physic_core.geometry.rotations import rotmat_to_euler as rotmat_to_euler
    from physic_core.geometry.rotations import rotmat_to_quat as rotmat_to_quat
    from physic_core.geometry.rotations import rotmat_to_rotvec as rotmat_to_rotvec
    from physic_core.geometry.rotations import rotvec_to_rotmat_numpy as rotvec_to_rotmat_numpy
    from physic_core.geometry.rotations import slerp as slerp
    from physic_core.geometry.rotations import swing_twist as swing_twist
    from physic_core.geometry.rotations import unit as unit
    from physic_core.geometry.rotvecs import rotvec_to_rotmat as rotvec_to_rotmat
    from physic_core.geometry.tensors import exact_arrays as exact_arrays
    from physic_core.geometry.tensors import optional_tensors as optional_tensors
    from physic_core.geometry.world_frame import transform_points as transform_points
    from physic_core.geometry.world_frame import up_in_camera as up_in_camera
    from physic_core.geometry.world_frame import world_from_camera as world_from_camera

_NAMES = {
    "alignment": "AlignmentOptions",
    "camera": "pixel_grid pixel_rays project undistort_pixels unproject",
    "colors": "lab_from_srgb linear_from_srgb",
    "floor": "FOCAL_PITCH_DEG FloorSearch PlaneFit plane_of_pixels",
    "inverse_depth": "InverseDepthMap LOWER_SHARE",
    "mesh": "coarse_mesh vertex_areas vertex_normals",
    "neighbors": "NearestPointSearch",
    "pointmap": "pointmap_normals",
    "raster": "rasterize",
    "rays": "RayCaster",
    "robust": "robust_loss",
    "rotations": "check_rotations cross frame_from_axes nearest_rotation rotate "
    "rotation_between rotmat_to_euler rotmat_to_quat rotmat_to_rotvec "
    "rotvec_to_rotmat_numpy slerp swing_twist unit",
    "rotvecs": "rotvec_to_rotmat",
    "tensors": "exact_arrays optional_tensors",
    "world_frame": "world_from_camera transform_points up_in_camera",
}

__getattr__ = importer(__name__, _NAMES)
