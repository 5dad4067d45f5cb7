"""Bodies of other models converted to SMPL-X parameters and to other meshes: fits of surfaces and
joints.
"""
