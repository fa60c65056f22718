"""The station: what a line touches in a browser, and the same by REST. It owns nothing of a run.

Side by side are the table of actions and what its rows, the REST interface and the server stand on, one thought each.
Their order, from the server down to the languages, is a contract of imports in `pyproject.toml`.
"""
