"""The quality figures of a production: the same functions for commands and pages."""
