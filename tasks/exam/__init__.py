"""Answers against truths that no stage can open."""
