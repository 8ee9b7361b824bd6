"""`python -m hilbridge`: the same as `hilbridge`."""

from hilbridge.cli import main

main()
