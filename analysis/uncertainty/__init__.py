"""Measurement uncertainty: declared figures of the sensors and how a loop was measured in; a budget of any metric out.

By sensitivity (GUM), and by Monte Carlo beside it (GUM-S1).
"""
