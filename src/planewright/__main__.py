"""`python -m planewright` is the command line."""

from planewright.cli.main import main

main()
