"""`python -m flows.service` runs the flow run of its environment: Prefect's engine under a name that child processes do not import again.

A child that is spawned imports its parent's main module, unless that is a `__main__.py`. Under `python -m prefect.engine` every solver
would import Prefect: 1.4 s of processor and 90 MB each.
"""

import runpy

if __name__ == "__main__":
    runpy.run_module("prefect.engine", run_name="__main__")
