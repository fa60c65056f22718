"""The metrics: one loop and what is asked of it in; a number out, read off by the row of a definition."""
