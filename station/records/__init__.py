"""What a run leaves on disk: its folder, manifest and seal, the samples and the chain that hangs all runs together.

Side by side are modules of one run's folder and of the folder of all runs, which need each other; what stands alone has
a room: `samples`, `ring`, `chain`.
"""
