"""Parts of the bridge node: the link to a run of SimGEN, and the thrust that acts in each step."""
