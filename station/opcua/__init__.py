"""OPC UA: the bench as a server for the systems of a plant, in a process of its own that runs know nothing of."""
