"""The folder of a run: its layout, its description and the environment it was made in."""
