"""The sweeper of the tiny line, less patient than the real one. By itself, as that is: its process imports no stage."""

from datetime import timedelta

from flows.service.sweeper import sweeper_flow

sweeper = sweeper_flow(unstarted=timedelta(seconds=120))
