"""Where recording and physics differ."""
