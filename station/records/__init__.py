"""What a run leaves on disk: its folder, manifest and seal, the samples and the chain that hangs all runs together."""
