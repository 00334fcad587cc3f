"""Tracked recordings whose cause is known: another mesh, integrator, material form and other force laws than the diagnosis has."""
