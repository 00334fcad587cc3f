"""The demo capture: a synthetic recording of a dressed actor with known truth."""
