"""Pages of the documentation site that are written from the code: see `site_pages.write_pages`."""
