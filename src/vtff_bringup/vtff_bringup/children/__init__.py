"""Child processes of a run: started, watched, replaced where that helps, and ended."""
