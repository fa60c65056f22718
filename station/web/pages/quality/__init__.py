"""The page of quality: the lot and its figures, limits on trial, and whether the bench can measure."""
