"""How well a computer keeps a scan period: the scan alone, what holds it up, and what to change."""
