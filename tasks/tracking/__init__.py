"""Follow one template mesh through a many-camera recording: every vertex keeps its number and its meaning."""
