"""`python -m flows` is `physavatar`."""

from flows.cli import main

main()
