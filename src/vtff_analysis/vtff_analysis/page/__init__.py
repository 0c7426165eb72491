"""Pages of results: one template for all, tables, pictures whose lines can be zoomed, citations."""
