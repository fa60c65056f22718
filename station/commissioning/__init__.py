"""Commissioning: the steps by which a technician finds out that a new bench is what its files say."""
