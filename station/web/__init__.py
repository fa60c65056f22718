"""The station: what a line touches in a browser, and the same by REST. It owns nothing of a run."""
