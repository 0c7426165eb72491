"""Study of paper 001: clusters by potential fields, the published code beside a corrected one."""
