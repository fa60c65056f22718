"""Commands on the quality of a production."""
