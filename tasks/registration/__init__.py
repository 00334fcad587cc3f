"""The body registered to the skin that was tracked."""
