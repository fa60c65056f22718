"""The store at the size of a plant: tables in months, counts and sums by the hour."""
