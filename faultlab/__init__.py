"""Runs with injected faults: scenarios judged, the matrix, the exits, over wires and in virtual time."""
