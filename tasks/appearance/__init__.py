"""Texture and light of the actor from images."""
