"""Every fault in every state, as a table."""
