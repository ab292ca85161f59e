"""The one door between controller and mock: both in memory, in virtual time."""
