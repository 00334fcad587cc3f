"""What the base model leaves out: one file per effect, found by walking the folder."""
