"""Texture and light of the actor from images, and pictures of the avatar."""
