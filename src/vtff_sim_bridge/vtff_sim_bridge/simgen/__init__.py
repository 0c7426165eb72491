"""Emulated SimGEN: the server of SimREMOTE and the state of its scenario."""
