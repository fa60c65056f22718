"""The store: a database that holds what the run folders say, to be asked. The folders stay the truth."""
