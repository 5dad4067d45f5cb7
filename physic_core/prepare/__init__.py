"""The photo before a run, and what the user gives with it: camera, people, keypoints, depth."""
