"""Re-evaluation at scale: what another recipe, metric definition or limit would have said of thousands of runs."""
