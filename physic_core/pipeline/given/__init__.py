"""What the user gives beside the photo: camera, people, keypoints, sizes and depth."""
