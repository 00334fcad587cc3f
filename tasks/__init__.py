"""The science, one folder per stage."""
