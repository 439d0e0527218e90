"""Published numbers beside those of this bench, as results/published: each source a module, each number a row."""
