"""Limits of the joints of people in MJCF files, from published ranges of motion.

Sources, of adults without disease:

- AAOS: American Academy of Orthopaedic Surgeons, Joint Motion (1965), as quoted in table A.1 of C. C. Norkin and
  D. J. White, Measurement of Joint Motion: shoulder 180 of abduction, 70 and 90 of rotation; forearm 80 and 80; wrist
  80 of flexion, 70 of extension, 20 and 30 sideways.
- Merck: Merck Manual, Normal Values for Range of Motion of Joints: hip 125 of flexion, 15 of extension, 45 of
  abduction, 45 and 45 of rotation; ankle 20 of dorsiflexion, 50 of plantar flexion; foot 35 of inversion, 25 of
  eversion; toes 30 of flexion, 80 of extension.
- Castori: M. Castori, ISRN Dermatology 2012, 751768, table 8: hip 30 of adduction.
- CFR: 38 CFR 4.71a, note 2 of the rating formula of the spine: neck 45 of flexion, extension and to each side, 80 of
  rotation; back 90 of flexion, 30 of extension, to each side, and of rotation.
- Dutton: AccessPhysiotherapy, Range of Motion for Diarthrodial Joints: clavicle 45 up, 5 down, 15 to the front and
  back, 45 of rotation; shoulder 135 and 45 in the horizontal plane.

Knees and elbows bend up to the bound of the reconstruction, 155 degrees; passive bends of deep squats are beyond the
135 of AAOS and the 130 of Merck.
"""

from __future__ import annotations

_BACK = (("x", -10.0, 30.0), ("z", -10.0, 10.0), ("y", -10.0, 10.0))  # CFR, a third for each of its three joints
_NECK = (("x", -22.5, 22.5), ("z", -22.5, 22.5), ("y", -40.0, 40.0))  # CFR, half for each of its two joints

LIMITS: dict[str, tuple[tuple[str, float, float], ...]] = {
    "hip": (("x", -125, 15), ("z", -30, 45), ("y", -45, 45)),  # Merck; Castori
    "knee": (("x", 0, 155),),
    "ankle": (("x", -20, 50), ("z", -35, 25), ("y", -20, 20)),  # Merck; about y, which no source has, a small play
    "foot": (("x", -80, 30),),  # Merck
    "spine1": _BACK,
    "spine2": _BACK,
    "spine3": _BACK,
    "neck": _NECK,
    "head": _NECK,
    "collar": (("z", -5, 45), ("y", -15, 15), ("x", -45, 0)),  # Dutton
    "shoulder": (("z", -90, 90), ("y", -135, 45), ("x", -90, 70)),  # AAOS; y Dutton
    "elbow": (("y", -155, 0), ("x", -80, 80)),  # x AAOS
    "wrist": (("z", -80, 70), ("y", -20, 30)),  # AAOS
}
"""Hinges of each joint of the left side, in their order, with limits in degrees, 0 in the T-pose (x left, y up, z
forward); those of the right side are mirrored. A pose beyond a limit widens it."""
