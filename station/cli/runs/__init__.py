"""Commands on single runs: list, show, verify, report, export, replay, and evaluation anew."""
