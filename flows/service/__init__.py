"""The service: the same stages, dispatched to worker pools through a Prefect server."""
