"""Validity: what the stages made of a trace, and how it was recorded, in; whether it may be judged at all out."""
