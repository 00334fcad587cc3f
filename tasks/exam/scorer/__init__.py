"""The only readers of a truth."""
