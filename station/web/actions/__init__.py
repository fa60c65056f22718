"""Everything that changes anything: a table of actions, what each is asked with, does and answers, by kinds.

A page and a REST request do the same: they perform a row.
"""
