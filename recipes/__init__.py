"""What shall be done: recipe and bench schemas, units, the strict loader, and the shipped files."""
