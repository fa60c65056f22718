"""`python -m station`: the same as `lostmotion`."""

from station.cli import main

main()
