"""One page per sequence."""
