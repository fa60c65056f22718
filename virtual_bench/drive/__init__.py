"""The drive's CiA 402 machine and its motion, without any wire."""
