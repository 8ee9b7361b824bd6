"""The arm on a bus of its own: what a device under test is given by the simulated plant, and gives it (dbc/plant.dbc)."""
