"""The samples of a run: how one scan is laid out, tables of many, and the sealed form."""
