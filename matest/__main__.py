"""`python -m matest`."""

from matest.cli import main

main()
