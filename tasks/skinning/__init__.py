"""Skin weights for the clothed surface, and moving it with the body."""
