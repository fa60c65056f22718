"""The station: what a line touches in a browser, and the same by REST. It owns nothing of a run.

The order of its modules and rooms, from the server down to the languages, is a contract of imports in `pyproject.toml`.
"""
