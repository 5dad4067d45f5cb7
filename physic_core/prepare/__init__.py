"""Prepare the photo, and what the user gives with it: camera, people, keypoints, depth."""
