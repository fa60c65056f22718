"""Checks of a recipe against itself and against its bench."""
