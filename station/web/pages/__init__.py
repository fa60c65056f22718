"""The pages of the station: what is seen in a browser."""
