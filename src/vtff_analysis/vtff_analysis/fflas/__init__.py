"""Study of paper 002: the extension phase of the FFLAS formation, planned and flown again."""
