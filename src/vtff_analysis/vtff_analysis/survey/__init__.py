"""Surveys of irregular plasma in recordings: what was learnt and decided, and figures of it."""
