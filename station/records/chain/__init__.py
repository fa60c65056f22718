"""The signed chain of a data folder: every run from its start, so that what is deleted, moved or forged shows."""
