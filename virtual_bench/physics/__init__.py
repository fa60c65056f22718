"""Reducer, brake and sensors as equations, and the units that can be on the bench."""
