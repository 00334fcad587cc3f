"""Keypoints: 133 points of COCO-WholeBody in every picture of a recording."""
