"""The drivers of simulated traffic, fitted to recorded ones and compared with them."""
