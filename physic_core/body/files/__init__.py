"""SMPL and SMPL-X files of the user, read without running what is in them."""
