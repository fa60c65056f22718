"""Reducers in closed form, measured with known errors: what the studies of uncertainty and of wrong passes run on."""
