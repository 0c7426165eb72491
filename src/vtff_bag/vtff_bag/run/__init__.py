"""The folder of a run: its making, the description of the run and its environment."""
