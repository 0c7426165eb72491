"""What reads recordings: reports, comparisons, exports, views, TEC, baselines and studies."""
