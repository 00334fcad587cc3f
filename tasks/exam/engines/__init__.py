"""Other people's engines: each file runs alone, as a process in an environment of its own, and makes the same motions that the generator asks for."""
