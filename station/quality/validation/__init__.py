"""The validation pack: what a customer's auditor asks of an installation, filled from its own evidence, and signed."""
