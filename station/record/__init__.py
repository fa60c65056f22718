"""What a run leaves on disk, and the ring that brings it there: folders, records, events, seals."""
