"""The parametric body behind the keypoints."""
