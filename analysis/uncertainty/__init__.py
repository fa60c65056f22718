"""Measurement uncertainty of every metric: declared figures, budget by sensitivity (GUM), and Monte Carlo (GUM-S1)."""
