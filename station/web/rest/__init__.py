"""The station by REST: an endpoint for each row of the table of actions, and what may be read."""
