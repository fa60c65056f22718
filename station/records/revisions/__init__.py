"""Revisions of recipes: the life of one, the history of all, and what people do to them."""
