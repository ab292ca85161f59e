"""The operator's page: a mission as it is flown, from the bus, or as it was, from its folder."""
