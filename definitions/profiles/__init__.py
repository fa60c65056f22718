"""Device profiles, what makes another device work without other code; each class is a section of a profile file.

The loader of files makes these classes, drivers and virtual bench read them. Each holds its own limits, and cannot be
made otherwise than they allow.
"""
