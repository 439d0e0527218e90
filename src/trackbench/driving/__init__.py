"""How a tracker is stepped: in this process where it is built in, in one of its own where it is not."""
