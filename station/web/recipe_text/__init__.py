"""The text of a recipe while somebody writes it: what is said of it, and what comes of it in virtual time."""
