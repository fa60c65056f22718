"""Commands on the store: make it again, look at it."""
