"""The 8-state relative filter of paper 000."""
