"""The vocabulary: tables of what things are called, what they mean and what is usual. It imports nothing of ours.

Each row stands here once. What computes its number, and what reads it from a file, is attached by its id elsewhere.
"""
