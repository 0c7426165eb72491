"""MCAP bags: files, recorder, player and the folder of a run; imports no algorithm."""
