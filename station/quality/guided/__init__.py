"""Guided studies: a plan, the runs in its order, and the evaluation of a whole design."""
