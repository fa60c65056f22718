"""What the store says of a production: yields, causes and values, formed by the database where there are many runs."""
