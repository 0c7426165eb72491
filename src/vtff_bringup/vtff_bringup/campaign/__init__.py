"""Campaigns: any run as a distribution, flown on Dask; one file, one table, one report."""
