"""Conversions between messages and the domain objects of the libraries."""
