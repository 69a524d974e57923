"""Numbers and facts out of a recording or a text; knows nothing of right or wrong."""
