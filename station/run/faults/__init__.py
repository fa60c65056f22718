"""Faults of a scenario that are done to the computer and not to the bench."""
